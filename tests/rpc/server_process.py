"""A server to be killed, frozen and cut off: the Robot service with handlers that do as the request says."""

from __future__ import annotations

import time
from typing import Any

from handeye.proto.methods import (
    CAMERA_GRAB_STEREO,
    ROBOT_ADVANCE,
    ROBOT_GET_STATE,
    ROBOT_PARK,
    ROBOT_RESET,
    ROBOT_STOP,
)
from handeye.proto.v1 import camera_pb2, robot_pb2
from handeye.rpc import Bus, BusSettings, Call, Handler, Method
from handeye.rpc.errors import OutOfLimits
from handeye.rpc.process import configure_logging, until_stopped


def get_state(_request: robot_pb2.GetStateRequest, call: Call) -> robot_pb2.RobotState:
    return robot_pb2.RobotState(world_time=1.0, lease_holder=call.caller)


def advance(request: robot_pb2.AdvanceRequest, call: Call) -> robot_pb2.RobotState:
    """Takes `duration` s and reports at once that it has begun."""
    call.progress(robot_pb2.MotionProgress(fraction=0.0))
    end = time.monotonic() + request.duration
    while time.monotonic() < end:
        call.check()
        time.sleep(0.005)
    return robot_pb2.RobotState(world_time=request.duration)


def park(_request: robot_pb2.ParkRequest, _call: Call) -> robot_pb2.RobotState:
    """Is deaf: looks at no deadline and no cancellation."""
    time.sleep(3.0)
    return robot_pb2.RobotState()


def stop(request: robot_pb2.StopRequest, _call: Call) -> robot_pb2.RobotState:
    raise ZeroDivisionError(request.reason)


def reset(_request: robot_pb2.ResetRequest, _call: Call) -> robot_pb2.RobotState:
    raise OutOfLimits("joint 3 would leave its limits", detail="joint_3")


def grab_stereo(_request: camera_pb2.GrabStereoRequest, _call: Call) -> camera_pb2.StereoPair:
    picture = camera_pb2.Frame(width=640, height=480, encoding="rgb8", data=bytes(640 * 480 * 3))
    return camera_pb2.StereoPair(left=picture, right=picture)


if __name__ == "__main__":
    configure_logging()
    handlers: dict[Method[Any, Any], Handler] = {
        ROBOT_GET_STATE: get_state,
        ROBOT_ADVANCE: advance,
        ROBOT_PARK: park,
        ROBOT_STOP: stop,
        ROBOT_RESET: reset,
        CAMERA_GRAB_STEREO: grab_stereo,
    }
    with until_stopped() as told, Bus.open(BusSettings(), "server", timeout=20.0) as bus, bus.serve(handlers):
        told.wait()
