from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from numpy.typing import NDArray

from handeye.robot_bridge.driver import Pace, RobotDriver, Watch, unwatched
from handeye.robot_bridge.drivers.simulated import SimulatedRobot
from handeye.rpc.errors import Busy, InvalidArgument, OutOfLimits, Stopped, Unreachable
from handeye.simulation import grasping, gripper, kinematics, puma
from handeye.simulation.objects import CUPS
from handeye.simulation.scene import STEP
from handeye.simulation.world import Clock, World

from .conftest import MakeWorld

AWAY = grasping.PARK + np.array([0.3, 0.1, 0.1, 0.2, -0.1, 0.4])


class Interrupt(Exception):
    pass


@contextmanager
def moving(robot: SimulatedRobot, goal: np.ndarray) -> Iterator[list[BaseException]]:
    """A motion in another thread, under way when the body runs and ended after it; yields what it raised."""
    begun = threading.Event()
    raised: list[BaseException] = []

    def watch(fraction: float) -> None:
        if fraction > 0.3:
            begun.set()
            time.sleep(0.002)  # lockstep would be over before the other thread has its say

    def run() -> None:
        try:
            robot.move_to_joints(goal, Pace(0.2, 0.5), watch)
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    assert begun.wait(10)
    try:
        yield raised
    finally:
        thread.join(20)
        assert not thread.is_alive()


def test_it_is_a_driver(robot: SimulatedRobot) -> None:
    driver: RobotDriver = robot
    description = driver.description
    assert description.clock == "lockstep"
    assert len(description.joint_names) == 6
    assert np.all(description.park > description.lower)
    assert np.all(description.park < description.upper)


def test_move_arrives_exactly_and_follows_closely(world: World, robot: SimulatedRobot) -> None:
    worst = 0.0

    def watch(_fraction: float) -> None:
        nonlocal worst
        worst = max(worst, float(np.abs(world.state().joints - world.motors()).max()))

    reached = robot.move_to_joints(AWAY, Pace(1.0, 1.0), watch)
    assert worst < np.radians(0.5)
    np.testing.assert_allclose(reached.joints, AWAY, atol=2e-5)
    assert not reached.moving
    assert reached.still_since <= reached.world_time
    tool = world.state().tool.position
    assert np.linalg.norm(tool - kinematics.forward(AWAY)[:3, 3]) < 5e-5


def test_pace_sets_the_time(robot: SimulatedRobot) -> None:
    robot.move_to_joints(AWAY)  # the first move is ramped
    begin = robot.park().world_time
    slow = robot.move_to_joints(AWAY, Pace(0.2, 1.0)).world_time - begin
    fast = robot.park(Pace(0.8, 1.0)).world_time - begin - slow
    assert slow > 3 * fast
    for pace in (Pace(0.0, 0.5), Pace(1e-320, 0.5), Pace(0.5, 1.1), Pace(float("nan"), 0.5)):
        with pytest.raises(InvalidArgument, match="pace"):
            robot.park(pace)


def test_progress_rises_to_one(robot: SimulatedRobot) -> None:
    seen: list[float] = []
    robot.move_to_joints(AWAY, watch=seen.append)
    assert seen == sorted(seen)
    assert seen[0] > 0
    assert seen[-1] == 1.0


def test_adjustments_add_up_without_drift(robot: SimulatedRobot) -> None:
    delta = np.array([0.02, -0.01, 0.015, 0.03, 0.01, -0.02])
    for _ in range(5):
        robot.adjust_joints(delta)
    reached = robot.adjust_joints(-5 * delta)
    np.testing.assert_allclose(reached.joints, grasping.PARK, atol=2e-5)


def test_move_to_point_keeps_the_tool_upright(world: World, robot: SimulatedRobot) -> None:
    before = world.state().tool.matrix()
    point = np.array([0.6, -0.1, 0.15])
    reached = robot.move_to_point(point)
    # The controller's rest a few steps after the motion: some micrometres.
    assert np.linalg.norm(reached.point - point) < 1e-5
    after = world.state().tool.matrix()
    np.testing.assert_allclose(after[:3, 3], point, atol=5e-5)
    np.testing.assert_allclose(after[:3, :3], before[:3, :3], atol=1e-4)
    with pytest.raises(Unreachable, match=r"\(2\.000, 0\.000, 0\.200\)"):
        robot.move_to_point(np.array([2.0, 0.0, 0.2]))


def test_the_point_is_what_the_encoders_say_not_the_truth(make_world: MakeWorld) -> None:
    world = make_world("default")
    state = SimulatedRobot(world).move_to_joints(AWAY)
    assert np.array_equal(state.point, kinematics.forward(state.joints)[:3, 3])
    assert 1e-5 < np.linalg.norm(state.point - world.state().tool.position) < 2e-3  # the play of the joints


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("side", [-1, 1])
def test_joint_limits_name_joint_limit_and_value(robot: SimulatedRobot, joint: int, side: int) -> None:
    goal = grasping.PARK.copy()
    goal[joint] = (puma.LOWER if side < 0 else puma.UPPER)[joint] + 0.05 * side
    with pytest.raises(OutOfLimits) as caught:
        robot.move_to_joints(goal)
    limit = (puma.LOWER if side < 0 else puma.UPPER)[joint]
    for word in (puma.JOINT_NAMES[joint], f"{goal[joint]:.4f}", f"{limit:.4f}"):
        assert word in caught.value.message
    assert robot.state().world_time == 0.0


def test_the_table_is_out_of_limits(robot: SimulatedRobot) -> None:
    with pytest.raises(OutOfLimits, match="above the table"):
        robot.move_to_joints(grasping.solve(grasping.grasp_pose(np.array([0.6, 0.0]), 0.008)))
    with pytest.raises(OutOfLimits, match="above the table"):
        robot.move_to_point(np.array([0.6, 0.0, -0.02]))


@pytest.mark.parametrize("values", [[0.0] * 5, [0.0] * 5 + [float("nan")], [[0.0] * 6]])
def test_wrong_vectors_are_refused(robot: SimulatedRobot, values: list[float]) -> None:
    for command in (robot.move_to_joints, robot.adjust_joints):
        with pytest.raises(InvalidArgument, match=r"must (have shape \(6,\)|be finite)"):
            command(np.array(values))
    with pytest.raises(InvalidArgument, match="point must be finite"):
        robot.move_to_point(np.array([0.5, np.inf, 0.2]))


def test_advance_lets_just_that_time_pass(robot: SimulatedRobot) -> None:
    for duration in (0.0, 0.05, 1.0):
        before = robot.state().world_time
        passed = robot.advance(duration).world_time - before
        assert duration - 1e-9 <= passed < duration + STEP
    assert robot.state().still_since == 0.0
    for wrong in (-1.0, float("nan"), float("inf")):
        with pytest.raises(InvalidArgument, match="duration"):
            robot.advance(wrong)


def test_gripper_opens_and_closes(robot: SimulatedRobot) -> None:
    assert robot.close_gripper().gripper_opening < 1e-3
    assert robot.open_gripper().gripper_opening == pytest.approx(gripper.RANGE, abs=1e-4)


def test_a_command_during_a_motion_is_busy(robot: SimulatedRobot) -> None:
    with moving(robot, AWAY) as raised:
        assert robot.state().moving
        assert robot.state().still_since == float("inf")
        for command in (robot.park, robot.close_gripper, robot.reset):
            with pytest.raises(Busy):
                command()
        with pytest.raises(Busy):
            robot.advance(0.1)
    assert not raised
    np.testing.assert_allclose(robot.state().joints, AWAY, atol=2e-5)


@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_stop_from_another_thread_brakes_on_the_path_and_latches(make_world: MakeWorld, clock: str) -> None:
    world = make_world(clock=clock)  # type: ignore[arg-type]
    robot = SimulatedRobot(world)
    with moving(robot, AWAY) as raised:
        halted = robot.stop("the door was opened")
        assert halted.stopped
        assert not halted.moving
    assert [type(error) for error in raised] == [Stopped]
    share = (halted.joints - grasping.PARK) / (AWAY - grasping.PARK)
    assert 0.1 < share[0] < 0.95
    np.testing.assert_allclose(share, share[0], atol=2e-3)
    velocity = np.diff([s.joints for s in world.history(0.0)], axis=0) / STEP
    assert np.all(np.abs(np.diff(velocity, axis=0) / STEP) < 1.5 * puma.ACCELERATION)
    for command in (robot.park, robot.open_gripper):
        with pytest.raises(Stopped, match="the door was opened"):
            command()


def test_the_first_move_after_start_and_reset_is_slow(robot: SimulatedRobot) -> None:
    def takes(goal: NDArray[np.float64], watch: Watch = unwatched) -> float:
        before = robot.state().world_time
        return robot.move_to_joints(goal, watch=watch).world_time - before

    def interrupt(_fraction: float) -> None:
        raise Interrupt

    robot.park()  # goes nowhere
    first, usual = takes(AWAY), takes(grasping.PARK)
    assert first > 1.5 * usual
    robot.stop("test")
    assert not robot.reset().stopped
    takes(grasping.PARK + 0.005)  # no move to speak of
    with pytest.raises(Interrupt):
        takes(AWAY, interrupt)  # not one that finished
    assert takes(AWAY) > 1.5 * usual
    assert takes(grasping.PARK) == pytest.approx(usual, abs=0.05)


@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_a_stop_between_the_checks_and_the_start_prevents_the_motion(
    make_world: MakeWorld, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = make_world(clock=clock)
    robot = SimulatedRobot(world)
    lowest_point = kinematics.lowest_point

    def stopping(joints: NDArray[np.float64]) -> float:
        robot.stop("during the checks")
        return lowest_point(joints)

    monkeypatch.setattr(kinematics, "lowest_point", stopping)
    before = world.motors()
    with pytest.raises(Stopped, match="during the checks"):
        robot.move_to_joints(AWAY)
    assert np.array_equal(world.motors(), before)
    assert robot.state().stopped
    assert not robot.state().moving


def test_a_stop_at_the_grippers_start_prevents_its_motion(
    world: World, robot: SimulatedRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    require = robot._require_unstopped
    stopper = threading.Thread(target=robot.stop, args=("just now",))

    def require_then_stop() -> None:
        require()
        if stopper.ident is None:
            stopper.start()
            deadline = time.monotonic() + 5.0
            while not robot.state().stopped:
                assert time.monotonic() < deadline
                time.sleep(0.001)

    monkeypatch.setattr(robot, "_require_unstopped", require_then_stop)
    with pytest.raises(Stopped, match="just now"):
        robot.close_gripper()
    stopper.join(5.0)
    assert world.time == 0.0
    assert robot.state().gripper_opening == pytest.approx(gripper.RANGE, abs=1e-4)


def test_a_refused_move_says_how_to_clear_the_stop(robot: SimulatedRobot) -> None:
    robot.stop("test")
    with pytest.raises(Stopped, match=r"reset it first \(handeye reset, or POST /v1/robot/reset\)"):
        robot.park()


def test_the_workspace_check_is_as_fine_on_long_paths(robot: SimulatedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    samples: list[NDArray[np.float64]] = []
    lowest_point = kinematics.lowest_point

    def seen(joints: NDArray[np.float64]) -> float:
        samples.append(joints.copy())
        return lowest_point(joints)

    monkeypatch.setattr(kinematics, "lowest_point", seen)
    goal = grasping.PARK.copy()
    goal[5] += 1.5
    robot.move_to_joints(goal, Pace(1.0, 1.0))
    assert np.abs(np.diff([grasping.PARK, *samples], axis=0)).max() < 0.03 + 1e-9
    np.testing.assert_allclose(samples[-1], goal)


def test_the_lab_changes_nothing_while_the_robot_lets_time_pass(world: World, robot: SimulatedRobot) -> None:
    refused = 0

    def watch(_fraction: float) -> None:
        nonlocal refused
        with pytest.raises(Busy):
            world.reset()
        with pytest.raises(Busy):
            world.place(CUPS["blue cup"], (0.6, 0.0))
        refused += 1

    robot.advance(STEP, watch)
    assert refused == 1
    world.place(CUPS["blue cup"], (0.6, 0.0))
    world.reset()


def test_a_watch_that_raises_brakes_and_passes_on(world: World, robot: SimulatedRobot) -> None:
    def watch(fraction: float) -> None:
        if fraction > 0.5:
            raise Interrupt

    with pytest.raises(Interrupt):
        robot.move_to_joints(AWAY, watch=watch)
    state = robot.state()
    assert not state.moving
    assert not state.stopped
    assert grasping.PARK[0] + 0.1 < state.joints[0] < AWAY[0] - 0.01
    with pytest.raises(Interrupt):
        robot.close_gripper(watch)
    assert 0.02 < robot.state().gripper_opening < 0.06
    robot.park()


def test_stop_out_of_a_watch_does_not_wait_for_itself(robot: SimulatedRobot) -> None:
    def watch(fraction: float) -> None:
        if fraction > 0.5:
            robot.stop("from inside")

    started = time.monotonic()
    with pytest.raises(Stopped, match="from inside"):
        robot.move_to_joints(AWAY, watch=watch)
    assert time.monotonic() - started < 2.0


def test_closing_the_driver_stops_the_arm(robot: SimulatedRobot) -> None:
    with moving(robot, AWAY) as raised:
        robot.close()
        assert not robot.state().moving
    assert [type(error) for error in raised] == [Stopped]


def test_realtime_keeps_the_machines_time(make_world: MakeWorld) -> None:
    world = make_world(clock="realtime")
    robot = SimulatedRobot(world)
    assert robot.description.clock == "realtime"
    started, first = time.monotonic(), world.time
    robot.move_to_joints(grasping.PARK + 0.05)
    robot.advance(0.4)
    elapsed = time.monotonic() - started
    # World time never hurries; on a loaded machine it may lag.
    assert 0.4 < world.time - first < elapsed + 0.3
    np.testing.assert_allclose(robot.state().joints, grasping.PARK + 0.05, atol=2e-5)


def test_backlash_hides_the_link_from_the_encoder(make_world: MakeWorld) -> None:
    world = make_world("default", seed=4)
    robot = SimulatedRobot(world)
    half = np.radians(0.05)
    goal = grasping.PARK + np.array([0.1, 0.1, 0.1, 0.1, -0.1, 0.1])
    delta = np.full(6, 0.05) * np.array([1, 1, 1, 1, -1, 1])
    robot.move_to_joints(goal - delta)
    forward = robot.move_to_joints(goal)
    link_forward = world.state().joints
    robot.move_to_joints(goal + delta)
    backward = robot.move_to_joints(goal)
    link_backward = world.state().joints
    # The encoder reads the same from both sides, the link does not: it lags by half the play.
    np.testing.assert_allclose(forward.joints, backward.joints, atol=1.5 * puma.ENCODER_STEP.max())
    np.testing.assert_allclose(link_forward - goal, -half * np.sign(delta), atol=2e-5)
    np.testing.assert_allclose(link_backward - goal, half * np.sign(delta), atol=2e-5)


def test_encoders_count_steps(make_world: MakeWorld) -> None:
    robot = SimulatedRobot(make_world("default"))
    counts = robot.move_to_joints(AWAY).joints / puma.ENCODER_STEP
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)


def test_the_ideal_profile_has_no_play(world: World, robot: SimulatedRobot) -> None:
    reached = robot.move_to_joints(AWAY)
    np.testing.assert_allclose(reached.joints, world.state().joints, atol=1e-12)
