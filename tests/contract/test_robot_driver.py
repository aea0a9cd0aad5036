"""What every `RobotDriver` promises, fake, guarded, simulated or remote."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from handeye.robot_bridge.driver import Joints, Pace, RobotDriver
from handeye.rpc.errors import Busy, InvalidArgument, OutOfLimits, RpcError, Stopped, Unreachable

READING = 0.005  # rad; backlash and encoder steps
POINT_READING = 2e-4  # m; encoder steps (0.05 mm at most), not backlash, which no encoder on a motor sees
BRISK, SLOW = Pace(1.0, 1.0), Pace(0.05, 0.5)


def nudge(robot: RobotDriver, size: float = 0.15) -> Joints:
    """A difference that leaves park towards the middle of every joint's range."""
    limits = robot.description
    return size * np.sign((limits.lower + limits.upper) / 2 - limits.park + 1e-9)


@contextmanager
def meanwhile(robot: RobotDriver, action: Callable[[], object]) -> Iterator[None]:
    """Does `action` from another thread as soon as `robot` moves; it has ended when the block has."""

    def act() -> None:
        deadline = time.monotonic() + 5.0
        while not robot.state().moving and time.monotonic() < deadline:
            time.sleep(0.001)
        action()

    thread = threading.Thread(target=act)
    thread.start()
    try:
        yield
    finally:
        thread.join(10.0)
        assert not thread.is_alive()


def test_the_description_is_coherent(robot: RobotDriver) -> None:
    about = robot.description
    n = len(about.joint_names)
    assert n == len(set(about.joint_names)) > 0
    for values in (about.lower, about.upper, about.speed, about.acceleration, about.park):
        assert values.shape == (n,)
        assert values.dtype == np.float64
    assert np.all(about.lower < about.upper)
    assert np.all((about.lower <= about.park) & (about.park <= about.upper))
    assert np.all((about.speed > 0) & (about.acceleration > 0))
    assert about.gripper_range > 0


def test_at_rest_it_stands_still_at_park_with_an_open_gripper(robot: RobotDriver) -> None:
    state = robot.state()
    assert state.joints == pytest.approx(robot.description.park, abs=READING)
    assert state.joints.shape == state.velocities.shape
    assert state.point.shape == (3,)
    assert state.point.dtype == np.float64
    assert np.isfinite(state.point).all()
    assert state.gripper_opening == pytest.approx(robot.description.gripper_range, abs=2e-3)
    assert not state.moving
    assert not state.stopped
    assert state.still_since <= state.world_time


def test_each_of_the_six_actions_returns_what_it_reached(robot: RobotDriver) -> None:
    park, delta = robot.description.park, nudge(robot)
    began = robot.state().world_time

    away = robot.adjust_joints(delta, BRISK)
    assert away.joints == pytest.approx(park + delta, abs=2 * READING)
    assert away.world_time > began
    assert away.still_since <= away.world_time
    assert not away.moving

    assert robot.move_to_joints(park + 0.5 * delta, BRISK).joints == pytest.approx(park + 0.5 * delta, abs=READING)
    assert robot.park(BRISK).joints == pytest.approx(park, abs=READING)
    assert robot.close_gripper().gripper_opening < 0.1 * robot.description.gripper_range
    opened = robot.open_gripper()
    assert opened.gripper_opening == pytest.approx(robot.description.gripper_range, abs=2e-3)
    assert opened.joints == pytest.approx(park, abs=READING)

    now = robot.state()
    assert now.joints == pytest.approx(opened.joints, abs=READING)
    assert not now.moving


def test_it_reports_the_point_that_it_was_sent_to(robot: RobotDriver) -> None:
    start = robot.state().point
    for offset in ([0.0, 0.05, 0.0], [0.03, 0.05, 0.04]):
        reached = robot.move_to_point(start + offset, BRISK)
        assert reached.point == pytest.approx(start + offset, abs=POINT_READING)
        assert robot.state().point == pytest.approx(reached.point, abs=POINT_READING)


def test_time_passes_while_it_waits(robot: RobotDriver) -> None:
    before = robot.state()
    after = robot.advance(0.25)
    passed = after.world_time - before.world_time
    assert passed >= 0.25 - 1e-6
    if robot.description.clock == "lockstep":
        assert passed == pytest.approx(0.25, abs=0.01)
    assert after.joints == pytest.approx(before.joints, abs=READING)


def test_in_lockstep_no_time_passes_otherwise(robot: RobotDriver) -> None:
    if robot.description.clock == "realtime":
        pytest.skip("time is free in realtime")
    before = robot.state().world_time
    time.sleep(0.05)
    assert robot.state().world_time == before


def test_a_faster_pace_takes_less_time(robot: RobotDriver) -> None:
    delta = nudge(robot)
    start = robot.state().world_time
    middle = robot.adjust_joints(delta, Pace(0.3, 0.3)).world_time
    end = robot.adjust_joints(-delta, BRISK).world_time
    assert end - middle < middle - start


def test_the_watch_sees_the_share_rise(robot: RobotDriver) -> None:
    shares: list[float] = []
    robot.adjust_joints(nudge(robot), BRISK, shares.append)
    assert shares
    assert shares == sorted(shares)
    assert shares[0] >= 0.0
    assert shares[-1] <= 1.0


def test_an_exception_of_the_watch_brakes_and_leaves(robot: RobotDriver) -> None:
    class Enough(Exception):
        pass

    def watch(fraction: float) -> None:
        if fraction > 0.02:
            raise Enough

    delta = nudge(robot, 0.5)
    with pytest.raises(Enough):
        robot.adjust_joints(delta, SLOW, watch)
    state = robot.state()
    assert not state.moving
    assert not state.stopped
    assert np.abs(state.joints - robot.description.park).max() < 0.4
    assert robot.park(BRISK).joints == pytest.approx(robot.description.park, abs=READING)


def test_a_stop_from_another_thread_brakes_and_latches_until_reset(robot: RobotDriver) -> None:
    with meanwhile(robot, lambda: robot.stop("enough")), pytest.raises(Stopped):
        robot.adjust_joints(nudge(robot, 0.5), SLOW)
    state = robot.state()
    assert state.stopped
    assert not state.moving
    assert np.abs(state.joints - robot.description.park).max() < 0.4
    for command in (robot.park, robot.open_gripper, robot.close_gripper):
        with pytest.raises(Stopped):
            command()
    with pytest.raises(Stopped):
        robot.adjust_joints(nudge(robot))
    assert robot.state().joints == pytest.approx(state.joints, abs=READING)
    assert not robot.reset().stopped
    assert robot.park(BRISK).joints == pytest.approx(robot.description.park, abs=READING)


def test_one_motion_at_a_time_and_the_state_at_any_time(robot: RobotDriver) -> None:
    refused: list[BaseException] = []

    def second() -> None:
        try:
            robot.close_gripper()
        except RpcError as error:
            refused.append(error)

    with meanwhile(robot, second):
        reached = robot.adjust_joints(
            nudge(robot, 0.5), Pace(0.5 if robot.description.clock == "realtime" else 0.1, 0.5)
        )
    assert [type(error) for error in refused] == [Busy]
    assert reached.gripper_opening == pytest.approx(robot.description.gripper_range, abs=2e-3)


def test_wrong_arguments_are_refused_before_anything_moves(robot: RobotDriver) -> None:
    n = len(robot.description.joint_names)
    before = robot.state()
    for wrong in ([], [0.0], [0.0] * (n + 1), [0.0] * (n - 1) + [np.nan], [np.inf] + [0.0] * (n - 1)):
        for command in (robot.move_to_joints, robot.adjust_joints):
            with pytest.raises(InvalidArgument):
                command(np.array(wrong))
    for pace in (Pace(0.0, 0.5), Pace(1e-320, 0.5), Pace(1.5, 0.5), Pace(0.5, -0.1), Pace(0.5, np.nan)):
        with pytest.raises(InvalidArgument):
            robot.adjust_joints(nudge(robot), pace)
    for duration in (-0.1, np.nan, np.inf):
        with pytest.raises(InvalidArgument):
            robot.advance(duration)
    after = robot.state()
    assert after.joints == pytest.approx(before.joints, abs=READING)
    if robot.description.clock == "lockstep":
        assert after.world_time == before.world_time


def test_joint_limits_are_kept_and_the_joint_is_named(robot: RobotDriver) -> None:
    about = robot.description
    for joint, name in enumerate(about.joint_names):
        for beyond in (about.lower[joint] - 0.05, about.upper[joint] + 0.05):
            target = about.park.copy()
            target[joint] = beyond
            with pytest.raises(OutOfLimits, match=name):
                robot.move_to_joints(target)
            with pytest.raises(OutOfLimits, match=name):
                robot.adjust_joints(target - about.park)
    assert robot.state().joints == pytest.approx(about.park, abs=READING)


def test_the_first_move_after_a_reset_is_ramped(robot: RobotDriver) -> None:
    delta = nudge(robot)
    robot.adjust_joints(delta, BRISK)  # some ramp the first move of all, too
    robot.park(BRISK)
    times = [robot.state().world_time]
    times.append(robot.adjust_joints(delta, BRISK).world_time)
    robot.stop("to be reset")
    times.append(robot.reset().world_time)
    with pytest.raises(OutOfLimits):  # what is refused is no first move
        robot.adjust_joints(np.full_like(delta, 10.0))
    robot.adjust_joints(np.zeros_like(delta))  # nor is what goes nowhere
    times.append(robot.state().world_time)
    times.append(robot.adjust_joints(-delta, BRISK).world_time)
    times.append(robot.adjust_joints(delta, BRISK).world_time)
    usual, _, _, ramped, again = np.diff(times)
    assert ramped > 1.5 * usual
    assert again == pytest.approx(usual, rel=0.3)


def test_points_out_of_reach_are_refused(robot: RobotDriver) -> None:
    with pytest.raises((Unreachable, OutOfLimits)):
        robot.move_to_point(np.array([5.0, 0.0, 0.5]))
    for wrong in (np.zeros(2), np.full(3, np.nan)):
        with pytest.raises(InvalidArgument):
            robot.move_to_point(wrong)
    assert robot.state().joints == pytest.approx(robot.description.park, abs=READING)
