"""Between the driver's types and the messages on the bus."""

from __future__ import annotations

import numpy as np

from handeye.camera_bridge.driver import CameraDescription, Course, Frame, HeadState, StereoPair
from handeye.proto.v1 import camera_pb2
from handeye.rpc.errors import Internal

ENCODING = "rgb8"
"""3 bytes a pixel, row by row, from the top left; the name that foxglove.RawImage and ROS give it."""


def frame_to_message(frame: Frame) -> camera_pb2.Frame:
    """The message of a picture."""
    height, width, _ = frame.image.shape
    return camera_pb2.Frame(
        world_time=frame.world_time,
        sequence=frame.sequence,
        width=width,
        height=height,
        encoding=ENCODING,
        data=frame.image.tobytes(),
    )


def frame_from_message(message: camera_pb2.Frame) -> Frame:
    """The picture in a message; its pixels are the message's own and read-only.

    `Internal` when size or encoding do not fit the data: then the camera bridge is at fault.
    """
    expected = message.height * message.width * 3
    if message.encoding != ENCODING or len(message.data) != expected:
        raise Internal(
            f"a {ENCODING} picture of {message.width} x {message.height} pixels has {expected} bytes; "
            f"the camera bridge sent {len(message.data)} bytes as {message.encoding!r}"
        )
    image = np.frombuffer(message.data, dtype=np.uint8).reshape(message.height, message.width, 3)
    return Frame(image, message.world_time, message.sequence)


def head_to_message(head: HeadState) -> camera_pb2.HeadState:
    """The message of a head state."""
    return camera_pb2.HeadState(pan=head.pan, tilt=head.tilt, moving=head.moving, world_time=head.world_time)


def head_from_message(message: camera_pb2.HeadState) -> HeadState:
    """The head state in a message."""
    return HeadState(message.pan, message.tilt, message.moving, message.world_time)


def course_to_message(course: Course, lasting: float, lease_id: str) -> camera_pb2.FollowHeadRequest:
    """The request to follow a course for `lasting` s."""
    return camera_pb2.FollowHeadRequest(
        lease_id=lease_id,
        pan=course.pan,
        tilt=course.tilt,
        pan_rate=course.pan_rate,
        tilt_rate=course.tilt_rate,
        world_time=course.world_time,
        lasting=lasting,
    )


def course_from_message(message: camera_pb2.FollowHeadRequest) -> Course:
    """The course in a request."""
    return Course(message.pan, message.tilt, message.pan_rate, message.tilt_rate, message.world_time)


def stereo_to_message(pair: StereoPair) -> camera_pb2.StereoPair:
    """The message of a stereo pair."""
    return camera_pb2.StereoPair(
        left=frame_to_message(pair.left),
        right=frame_to_message(pair.right),
        skew=pair.skew,
        head=head_to_message(pair.head),
    )


def stereo_from_message(message: camera_pb2.StereoPair) -> StereoPair:
    """The stereo pair in a message."""
    return StereoPair(
        frame_from_message(message.left),
        frame_from_message(message.right),
        message.skew,
        head_from_message(message.head),
    )


def description_to_message(description: CameraDescription) -> camera_pb2.CameraDescription:
    """The message of a description."""
    return camera_pb2.CameraDescription(
        width=description.width,
        height=description.height,
        pan_lower=description.pan_range[0],
        pan_upper=description.pan_range[1],
        tilt_lower=description.tilt_range[0],
        tilt_upper=description.tilt_range[1],
        step=description.step,
        speed=description.speed,
        latency=description.latency,
    )


def description_from_message(message: camera_pb2.CameraDescription) -> CameraDescription:
    """The description in a message."""
    return CameraDescription(
        width=message.width,
        height=message.height,
        pan_range=(message.pan_lower, message.pan_upper),
        tilt_range=(message.tilt_lower, message.tilt_upper),
        step=message.step,
        speed=message.speed,
        latency=message.latency,
    )
