from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from handeye.proto.v1 import robot_pb2
from handeye.robot_bridge import convert
from handeye.robot_bridge.driver import Pace, RobotState
from handeye.robot_bridge.limits import LEAST_PACE
from handeye.rpc.errors import Internal, InvalidArgument
from tests.robot_bridge.fake_robot import FakeRobot

NUMBERS = st.floats(allow_nan=False)
VECTORS = st.lists(NUMBERS, max_size=8).map(np.array)


def same(one: object, other: object) -> bool:
    """Equality of dataclasses that hold arrays."""
    pairs = zip(dataclasses.astuple(one), dataclasses.astuple(other), strict=True)  # type: ignore[call-overload]
    return all(np.array_equal(a, b) for a, b in pairs)


@settings(deadline=None)
@given(
    st.builds(
        RobotState,
        world_time=NUMBERS,
        joints=VECTORS,
        velocities=VECTORS,
        point=VECTORS,
        gripper_opening=NUMBERS,
        moving=st.booleans(),
        stopped=st.booleans(),
        still_since=st.one_of(st.just(math.inf), NUMBERS),
        lease_holder=st.sampled_from(["", "coordinator", "Übungsleiter"]),
    )
)
def test_a_state_survives_the_bus(state: RobotState) -> None:
    wire = convert.state_to_message(state).SerializeToString()
    assert same(convert.state_from_message(robot_pb2.RobotState.FromString(wire)), state)


@pytest.mark.parametrize("clock", ["realtime", "lockstep"])
def test_a_description_survives_the_bus(clock: str) -> None:
    description = FakeRobot(clock).description  # type: ignore[arg-type]
    wire = convert.description_to_message(description).SerializeToString()
    assert same(convert.description_from_message(robot_pb2.RobotDescription.FromString(wire)), description)


def test_a_clock_that_nobody_knows_is_an_error() -> None:
    with pytest.raises(Internal, match="clock"):
        convert.description_from_message(robot_pb2.RobotDescription())


@settings(deadline=None)
@given(st.floats(LEAST_PACE, 1.0), st.floats(LEAST_PACE, 1.0))
def test_a_pace_survives_the_bus(speed: float, acceleration: float) -> None:
    pace = Pace(speed, acceleration)
    assert convert.pace_from_message(convert.pace_to_message(pace)) == pace


def test_no_pace_is_the_default_and_zero_cannot_be_sent() -> None:
    assert convert.pace_from_message(robot_pb2.Pace()) == Pace()
    with pytest.raises(InvalidArgument, match="speed"):
        convert.pace_to_message(Pace(speed=0.0))
