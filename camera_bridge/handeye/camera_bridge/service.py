"""Serves cameras and head on the bus, and publishes stereo pairs while somebody watches."""

from __future__ import annotations

import math
import threading
from contextlib import ExitStack
from types import TracebackType
from typing import Self

import structlog

from handeye.camera_bridge.convert import (
    course_from_message,
    description_to_message,
    frame_to_message,
    head_to_message,
    stereo_to_message,
)
from handeye.camera_bridge.driver import CameraDescription, CameraDriver, HeadDriver
from handeye.proto.methods import (
    CAMERA_DESCRIBE,
    CAMERA_FOLLOW_HEAD,
    CAMERA_GET_HEAD,
    CAMERA_GRAB_OBSERVER,
    CAMERA_GRAB_STEREO,
    CAMERA_MOVE_HEAD,
    CAMERA_STEREO,
)
from handeye.proto.v1 import camera_pb2
from handeye.rpc import Bus, Call
from handeye.rpc.errors import InvalidArgument, RpcError

_log = structlog.get_logger(__name__)

_REPLY_TIME = 0.15
"""Seconds kept back from the caller's time, so that the reason why there is no picture arrives in time."""

_STREAM_TIMEOUT = 5.0
"""Seconds that the stream waits for a picture."""


class CameraService:
    """Cameras and head on the bus, from `with` to its end. The drivers stay their owner's to close."""

    def __init__(self, cameras: CameraDriver, head: HeadDriver, bus: Bus, stream_rate: float = 5.0) -> None:
        """`stream_rate`: stereo pairs a second on the stream, at most."""
        self._cameras = cameras
        self._head = head
        self._bus = bus
        self._stream_period = 1.0 / stream_rate
        self._closing = threading.Event()
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            publisher = threading.Thread(target=self._publish, name="camera-stream")
            publisher.start()
            stack.callback(publisher.join)
            stack.callback(self._closing.set)
            stack.enter_context(
                self._bus.serve(
                    {
                        CAMERA_DESCRIBE: self._describe,
                        CAMERA_GRAB_STEREO: self._grab_stereo,
                        CAMERA_GRAB_OBSERVER: self._grab_observer,
                        CAMERA_GET_HEAD: self._get_head,
                        CAMERA_MOVE_HEAD: self._move_head,
                        CAMERA_FOLLOW_HEAD: self._follow_head,
                    }
                )
            )
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def _describe(self, _request: camera_pb2.DescribeCameraRequest, _call: Call) -> camera_pb2.CameraDescription:
        height, width = self._cameras.size
        pan_range, tilt_range = self._head.limits
        return description_to_message(
            CameraDescription(
                width=width,
                height=height,
                pan_range=pan_range,
                tilt_range=tilt_range,
                step=self._head.step,
                speed=self._head.speed,
                latency=self._cameras.latency,
            )
        )

    def _grab_stereo(self, request: camera_pb2.GrabStereoRequest, call: Call) -> camera_pb2.StereoPair:
        wanted = _world_time(request.not_older_than)
        return stereo_to_message(self._cameras.grab_stereo(wanted, _time_to_work(call), call.check))

    def _grab_observer(self, request: camera_pb2.GrabObserverRequest, call: Call) -> camera_pb2.Frame:
        return frame_to_message(self._cameras.grab_observer(_world_time(request.not_older_than), _time_to_work(call)))

    def _get_head(self, _request: camera_pb2.GetHeadRequest, _call: Call) -> camera_pb2.HeadState:
        return head_to_message(self._head.state())

    def _move_head(self, request: camera_pb2.MoveHeadRequest, call: Call) -> camera_pb2.HeadState:
        timeout = _time_to_work(call)
        return head_to_message(self._head.move(request.pan, request.tilt, request.lease_id, timeout, call.check))

    def _follow_head(self, request: camera_pb2.FollowHeadRequest, call: Call) -> camera_pb2.HeadState:
        course, timeout = course_from_message(request), _time_to_work(call)
        return head_to_message(self._head.follow(course, request.lasting, request.lease_id, timeout))

    def _publish(self) -> None:
        """The newest pair again and again, while somebody watches and only when it is a new one."""
        newest, failing = -1, False
        while not self._closing.wait(self._stream_period):
            try:
                if not self._bus.is_watched(CAMERA_STEREO):
                    newest = -1  # who comes next gets a picture at once, also when the world stands still
                    continue
                pair = self._cameras.grab_stereo(0.0, _STREAM_TIMEOUT)
                if pair.left.sequence != newest:
                    self._bus.publish(CAMERA_STEREO, stereo_to_message(pair))
                newest, failing = pair.left.sequence, False
            except Exception as error:  # a picture that fails must not end the stream
                if not failing:
                    unforeseen = not isinstance(error, RpcError)
                    _log.warning("no stereo pair to publish", error=str(error), exc_info=unforeseen)
                failing = True


def _world_time(value: float) -> float:
    """The world time asked for, in s; `InvalidArgument` when it is no number that a wait could reach."""
    if not math.isfinite(value):
        raise InvalidArgument(f"not_older_than is a world time in s, a finite number; got {value}")
    return value


def _time_to_work(call: Call) -> float:
    left = call.time_left()
    return max(0.0, left - min(_REPLY_TIME, 0.3 * left))
