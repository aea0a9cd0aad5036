"""The camera bridge: both cameras of the stereo rig, the observer's camera and the pan/tilt head, on the bus."""

from handeye.camera_bridge.driver import (
    CameraDescription,
    CameraDriver,
    Frame,
    HeadDriver,
    HeadState,
    Image,
    StereoPair,
)

__all__ = ["CameraDescription", "CameraDriver", "Frame", "HeadDriver", "HeadState", "Image", "StereoPair"]
