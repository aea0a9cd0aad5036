from __future__ import annotations

import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from handeye.robot_bridge.driver import Pace, RobotDriver
from handeye.robot_bridge.guard import GuardedRobot
from handeye.rpc.errors import Busy, DeadlineExceeded, InvalidArgument, OutOfLimits, Slipping, Stopped, Unreachable
from tests.robot_bridge.fake_robot import FakeRobot

NAN, INF = float("nan"), float("inf")


@pytest.fixture
def fake() -> FakeRobot:
    return FakeRobot()


@pytest.fixture
def robot(fake: FakeRobot) -> GuardedRobot:
    return GuardedRobot(fake)


@pytest.mark.parametrize("values", [[], [0.0, 0.0], [0.0] * 4, [[0.0] * 3], [0.0, NAN, 0.0], [0.0, INF, 0.0]])
@pytest.mark.parametrize("command", ["move_to_joints", "adjust_joints", "move_to_point"])
def test_shape_and_finiteness(robot: GuardedRobot, fake: FakeRobot, command: str, values: list[float]) -> None:
    with pytest.raises(InvalidArgument, match=r"must (have shape \(3,\)|be finite)"):
        getattr(robot, command)(np.array(values))
    assert fake.time == 0.0


@pytest.mark.parametrize("pace", [Pace(0.0, 0.5), Pace(0.5, 0.0), Pace(1.01, 0.5), Pace(0.5, -1.0), Pace(NAN, 0.5)])
def test_the_pace_is_a_share(robot: GuardedRobot, fake: FakeRobot, pace: Pace) -> None:
    with pytest.raises(InvalidArgument, match="share in"):
        robot.park(pace)
    with pytest.raises(InvalidArgument, match="share in"):
        robot.adjust_joints(np.zeros(3), pace)
    assert fake.time == 0.0


@pytest.mark.parametrize(
    ("joints", "name", "value", "limits"),
    [
        ([2.001, 0.0, 0.0], "waist", "2.0010", "[-2.0000, 2.0000]"),
        ([0.0, -1.6, 0.0], "shoulder", "-1.6000", "[-1.5000, 1.5000]"),
        ([0.0, 0.0, 1.25], "elbow", "1.2500", "[-1.0000, 1.0000]"),
    ],
)
def test_joint_limits_name_joint_value_and_limits(
    robot: GuardedRobot, fake: FakeRobot, joints: list[float], name: str, value: str, limits: str
) -> None:
    with pytest.raises(OutOfLimits) as refused:
        robot.move_to_joints(np.array(joints))
    assert f"{name} would be {value} rad, its limits are {limits}" in refused.value.message
    assert refused.value.detail == name
    with pytest.raises(OutOfLimits, match=name):
        robot.adjust_joints(np.array(joints) - fake.state().joints)
    assert fake.time == 0.0


@settings(deadline=None)
@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_a_motion_stays_within_the_limits_or_does_not_begin(target: list[float]) -> None:
    robot = GuardedRobot(FakeRobot())
    limits = robot.description
    allowed = bool(np.all((target >= limits.lower) & (target <= limits.upper)))
    try:
        reached = robot.move_to_joints(np.array(target), Pace(1.0, 1.0))
    except OutOfLimits:
        assert not allowed
        assert robot.state().world_time == 0.0
    else:
        assert allowed
        assert reached.joints == pytest.approx(target)


def test_an_arm_is_not_stuck_at_a_limit_where_its_encoder_reads_a_step_too_much(
    robot: GuardedRobot, fake: FakeRobot
) -> None:
    limit = robot.description.upper[0]
    fake.tolerance = 0.01
    fake._joints = np.array([limit + 0.0005, 0.0, 0.0])
    with pytest.raises(OutOfLimits, match="waist"):
        robot.adjust_joints(np.array([0.001, 0.0, 0.0]))
    assert robot.adjust_joints(np.array([0.0, 0.1, 0.0])).joints[1] == pytest.approx(0.1)


def test_the_arm_brakes_when_what_it_holds_slips(robot: GuardedRobot, fake: FakeRobot) -> None:
    def closing(fraction: float) -> None:
        fake._opening = 0.06 - 0.02 * fraction

    delta = np.array([0.4, 0.0, 0.0])
    with pytest.raises(Slipping, match=r"closed to 0\.0[45]"):
        robot.adjust_joints(delta, Pace(), closing, least_opening=0.05)
    state = robot.state()
    assert (state.moving, state.stopped) == (False, False)
    assert 0.1 < state.joints[0] < 0.3
    assert robot.adjust_joints(delta - state.joints, Pace(), closing).joints == pytest.approx(delta)


@pytest.mark.parametrize("opening", [-0.001, 1.0, NAN])
def test_the_least_opening_lies_in_the_grippers_range(robot: GuardedRobot, fake: FakeRobot, opening: float) -> None:
    with pytest.raises(InvalidArgument, match="an opening must lie in"):
        robot.adjust_joints(np.zeros(3), least_opening=opening)
    assert fake.time == 0.0


@pytest.mark.parametrize("duration", [-0.1, 60.1, NAN, INF])
def test_how_long_one_may_wait(robot: GuardedRobot, duration: float) -> None:
    with pytest.raises(InvalidArgument, match="duration"):
        robot.advance(duration)


def test_the_drivers_own_refusals_pass_through(robot: GuardedRobot) -> None:
    with pytest.raises(Unreachable):
        robot.move_to_point(np.array([2.0, 0.0, 0.0]))
    assert not robot.state().stopped


def test_one_motion_at_a_time(robot: GuardedRobot) -> None:
    refused = []

    def watch(_fraction: float) -> None:
        with pytest.raises(Busy, match="motion is under way"):
            robot.close_gripper()
        with pytest.raises(Busy):
            robot.reset()
        with pytest.raises(DeadlineExceeded):
            robot.wait_until_idle(0.0)
        assert robot.state().moving
        refused.append(True)

    robot.advance(0.02, watch)
    assert refused
    assert not robot.state().moving
    robot.wait_until_idle(0.0)


def commands(robot: RobotDriver) -> list[object]:
    return [
        lambda: robot.park(),
        lambda: robot.open_gripper(),
        lambda: robot.close_gripper(),
        lambda: robot.move_to_point(np.zeros(3)),
        lambda: robot.move_to_joints(np.zeros(3)),
        lambda: robot.adjust_joints(np.zeros(3)),
        lambda: robot.advance(0.1),
    ]


def test_nothing_moves_while_stopped(robot: GuardedRobot) -> None:
    assert robot.stop("a hand in the way").stopped
    robot.stop("another reason")
    for command in commands(robot):
        with pytest.raises(Stopped, match="a hand in the way"):
            command()  # type: ignore[operator]
    assert robot.state().stopped
    assert not robot.reset().stopped
    robot.park()


def test_a_stop_that_the_driver_latched_itself_counts_too(robot: GuardedRobot, fake: FakeRobot) -> None:
    fake.stop()
    with pytest.raises(Stopped, match="reset it first"):
        robot.park()


def test_a_stop_ends_the_motion_even_if_the_driver_ignores_it(robot: GuardedRobot, fake: FakeRobot) -> None:
    fake.stop = lambda reason="": fake.state()  # type: ignore[method-assign]
    stopper = threading.Thread(target=robot.stop, args=("pressed",))

    def watch(fraction: float) -> None:
        if fraction > 0.5 and stopper.ident is None:
            stopper.start()
            stopper.join()

    with pytest.raises(Stopped, match="pressed"):
        robot.move_to_joints(np.array([1.0, 0.0, 0.0]), Pace(), watch)
    assert 0.4 < robot.state().joints[0] < 0.6
    assert robot.state().stopped


def test_what_ends_a_motion_with_stopped_latches(robot: GuardedRobot) -> None:
    def watch(_fraction: float) -> None:
        raise Stopped("the holder is silent")

    with pytest.raises(Stopped, match="the holder is silent"):
        robot.advance(0.1, watch)
    with pytest.raises(Stopped, match="the holder is silent"):
        robot.advance(0.1)


def test_any_other_error_of_the_watch_brakes_without_latching(robot: GuardedRobot) -> None:
    def watch(_fraction: float) -> None:
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        robot.advance(0.1, watch)
    robot.advance(0.1)
