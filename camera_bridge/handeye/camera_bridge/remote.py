"""Cameras and head as the rest of the bus sees them: drivers whose methods are calls to the camera bridge."""

from __future__ import annotations

from functools import cached_property

from handeye.camera_bridge.convert import (
    course_to_message,
    description_from_message,
    frame_from_message,
    head_from_message,
    stereo_from_message,
)
from handeye.camera_bridge.driver import CameraDescription, Course, Frame, HeadState, StereoPair, Tick
from handeye.proto.methods import (
    CAMERA_DESCRIBE,
    CAMERA_FOLLOW_HEAD,
    CAMERA_GET_HEAD,
    CAMERA_GRAB_OBSERVER,
    CAMERA_GRAB_STEREO,
    CAMERA_MOVE_HEAD,
)
from handeye.proto.v1 import camera_pb2
from handeye.robot_bridge.remote import heartbeat
from handeye.rpc import Bus

CALL_TIMEOUT = 2.0
"""Seconds that a call without pictures and without motion may take."""


class RemoteCameras:
    """A `CameraDriver` on the bus. Errors are the bridge's, and `Unavailable` when it cannot be reached."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus

    @cached_property
    def description(self) -> CameraDescription:
        """What the bridge's cameras and head are; asked once."""
        return _describe(self._bus)

    @property
    def size(self) -> tuple[int, int]:
        """Image size as (rows, columns)."""
        return self.description.height, self.description.width

    @property
    def latency(self) -> float:
        """A frame can be had this long after what it shows, in s of world time."""
        return self.description.latency

    def grab_stereo(self, not_older_than: float, timeout: float, on_tick: Tick | None = None) -> StereoPair:
        """A pair of which neither picture shows a time before `not_older_than` (world time in s)."""
        request = camera_pb2.GrabStereoRequest(not_older_than=not_older_than)
        return stereo_from_message(self._bus.call(CAMERA_GRAB_STEREO, request, timeout=timeout, on_tick=on_tick))

    def grab_observer(self, not_older_than: float, timeout: float) -> Frame:
        """A picture from the observer's camera, for people."""
        request = camera_pb2.GrabObserverRequest(not_older_than=not_older_than)
        return frame_from_message(self._bus.call(CAMERA_GRAB_OBSERVER, request, timeout=timeout))

    def close(self) -> None:
        """Nothing to release: the bus stays its owner's to close."""


class RemoteHead:
    """A `HeadDriver` on the bus. While a move runs, it sends the heartbeats of the lease under which it runs."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus

    @cached_property
    def description(self) -> CameraDescription:
        """What the bridge's cameras and head are; asked once."""
        return _describe(self._bus)

    @property
    def limits(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """((pan lowest, pan highest), (tilt lowest, tilt highest)) in rad."""
        return self.description.pan_range, self.description.tilt_range

    @property
    def step(self) -> float:
        """Smallest step of both axes in rad; 0 for none."""
        return self.description.step

    @property
    def speed(self) -> float:
        """Greatest speed of both axes in rad/s."""
        return self.description.speed

    def state(self) -> HeadState:
        """Where the head points now."""
        return head_from_message(self._bus.call(CAMERA_GET_HEAD, camera_pb2.GetHeadRequest(), timeout=CALL_TIMEOUT))

    def move(self, pan: float, tilt: float, lease_id: str, timeout: float, on_tick: Tick | None = None) -> HeadState:
        """Turns to (pan, tilt) in rad, rounded to the unit's steps; returns when it stands still."""
        request = camera_pb2.MoveHeadRequest(lease_id=lease_id, pan=pan, tilt=tilt)
        beat = heartbeat(self._bus, lease_id)

        def beat_and_tick() -> None:
            beat()
            if on_tick is not None:
                on_tick()

        return head_from_message(self._bus.call(CAMERA_MOVE_HEAD, request, timeout=timeout, on_tick=beat_and_tick))

    def follow(self, course: Course, lasting: float, lease_id: str, timeout: float) -> HeadState:
        """Begins to turn so that it comes to point where `course` says, for `lasting` s; returns at once."""
        request = course_to_message(course, lasting, lease_id)
        return head_from_message(self._bus.call(CAMERA_FOLLOW_HEAD, request, timeout=timeout))

    def close(self) -> None:
        """Nothing to release: the bus stays its owner's to close."""


def _describe(bus: Bus) -> CameraDescription:
    return description_from_message(bus.call(CAMERA_DESCRIBE, camera_pb2.DescribeCameraRequest(), timeout=CALL_TIMEOUT))
