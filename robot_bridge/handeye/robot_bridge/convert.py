"""Between the driver's dataclasses and the messages on the bus."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from handeye.proto.v1 import robot_pb2
from handeye.robot_bridge.driver import Pace, RobotDescription, RobotState
from handeye.robot_bridge.limits import check_pace
from handeye.rpc.errors import Internal

_CLOCKS: dict[Literal["realtime", "lockstep"], robot_pb2.Clock.ValueType] = {
    "realtime": robot_pb2.CLOCK_REALTIME,
    "lockstep": robot_pb2.CLOCK_LOCKSTEP,
}


def vector(values: Sequence[float]) -> NDArray[np.float64]:
    """A repeated field as a float64 array of shape (n,)."""
    return np.array(values, dtype=np.float64)


def state_to_message(state: RobotState) -> robot_pb2.RobotState:
    """The message of `state`."""
    return robot_pb2.RobotState(
        world_time=state.world_time,
        joints=state.joints.tolist(),
        velocities=state.velocities.tolist(),
        point=state.point.tolist(),
        gripper_opening=state.gripper_opening,
        moving=state.moving,
        stopped=state.stopped,
        still_since=state.still_since,
        lease_holder=state.lease_holder,
    )


def state_from_message(message: robot_pb2.RobotState) -> RobotState:
    """The state that `message` carries."""
    return RobotState(
        world_time=message.world_time,
        joints=vector(message.joints),
        velocities=vector(message.velocities),
        point=vector(message.point),
        gripper_opening=message.gripper_opening,
        moving=message.moving,
        stopped=message.stopped,
        still_since=message.still_since,
        lease_holder=message.lease_holder,
    )


def description_to_message(description: RobotDescription) -> robot_pb2.RobotDescription:
    """The message of `description`."""
    return robot_pb2.RobotDescription(
        joint_names=description.joint_names,
        lower=description.lower.tolist(),
        upper=description.upper.tolist(),
        speed=description.speed.tolist(),
        acceleration=description.acceleration.tolist(),
        park=description.park.tolist(),
        gripper_range=description.gripper_range,
        clock=_CLOCKS[description.clock],
    )


def description_from_message(message: robot_pb2.RobotDescription) -> RobotDescription:
    """The description that `message` carries; `Internal` when its clock is none that we know."""
    clocks = [name for name, value in _CLOCKS.items() if value == message.clock]
    if not clocks:
        raise Internal(f"the robot bridge reports clock {message.clock}, known are {sorted(_CLOCKS)}")
    return RobotDescription(
        joint_names=tuple(message.joint_names),
        lower=vector(message.lower),
        upper=vector(message.upper),
        speed=vector(message.speed),
        acceleration=vector(message.acceleration),
        park=vector(message.park),
        gripper_range=message.gripper_range,
        clock=clocks[0],
    )


def pace_to_message(pace: Pace) -> robot_pb2.Pace:
    """The message of `pace`; `InvalidArgument` outside [0.001, 1]: 0 on the bus means the default."""
    check_pace(pace)
    return robot_pb2.Pace(speed=pace.speed, acceleration=pace.acceleration)


def pace_from_message(message: robot_pb2.Pace) -> Pace:
    """The pace that `message` carries; a share of 0 stands for the default."""
    default = Pace()
    return Pace(
        speed=message.speed if message.speed != 0.0 else default.speed,
        acceleration=message.acceleration if message.acceleration != 0.0 else default.acceleration,
    )
