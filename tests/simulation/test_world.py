from __future__ import annotations

import hashlib
import subprocess
import sys

import numpy as np
import pybullet
import pytest

from handeye.robot_bridge.drivers.simulated import SimulatedRobot
from handeye.rpc.errors import Busy, InvalidArgument
from handeye.simulation import grasping, gripper, puma
from handeye.simulation.objects import BALL, CUPS, GRID, ObjectSpec
from handeye.simulation.pose import Pose
from handeye.simulation.profile import Profile
from handeye.simulation.scene import FINGER_1, FINGER_2, STEP
from handeye.simulation.world import World

CUP = CUPS["blue cup"]
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


def fingerprint(world: World, seed: int) -> str:
    """A hash of every bit of a short life: reset, place, reach, push, grasp, lift."""
    world.reset(seed)
    world.place(CUP, (0.58, 0.04), yaw=0.3)
    world.place(CUPS["red tumbler"], (0.70, -0.08))
    robot = SimulatedRobot(world)
    chain = grasping.solve_chain(np.array([0.58, 0.045]))
    robot.move_to_joints(chain["approach"])
    robot.move_to_joints(chain["grasp"])
    robot.close_gripper()
    robot.move_to_joints(chain["lift"])
    digest = hashlib.sha256()
    for row in world._physics.history._rows:
        digest.update(row.numbers.tobytes())
    digest.update(robot.state().joints.tobytes())
    return digest.hexdigest()


def test_same_reset_seed_and_calls_give_the_same_bits_in_any_process() -> None:
    with World(Profile.named("default"), seed=5) as world:
        first = fingerprint(world, 7)
        again = fingerprint(world, 7)
        other = fingerprint(world, 8)
    assert first == again
    assert first != other
    code = (
        "import runpy, sys; names = runpy.run_path(sys.argv[1]);"
        "world = names['World'](names['Profile'].named('default'));"
        "print('hash', names['fingerprint'](world, 7)); world.close()"
    )
    command = [sys.executable, "-c", code, __file__]
    result = subprocess.run(command, capture_output=True, text=True, check=False, timeout=100)
    assert result.returncode == 0, result.stderr
    assert f"hash {first}" in result.stdout


def test_world_starts_parked_open_and_still(world: World) -> None:
    state = world.state()
    assert state.world_time == 0.0
    assert state.objects == ()
    np.testing.assert_allclose(state.joints, grasping.PARK)
    np.testing.assert_allclose(state.fingers, gripper.FINGER_TRAVEL)
    assert world.still_since == 0.0
    assert not world.busy


def test_place_settles_upright_and_a_resting_cup_does_not_creep(world: World) -> None:
    for index, spec in enumerate(CUPS.values()):
        world.place(spec, (0.5 + 0.12 * (index % 3), 0.2 * (index // 3) - 0.1), yaw=0.4 * index)
    placed = world.state()
    assert world.scene().objects == tuple(CUPS.values())
    SimulatedRobot(world).advance(6.0)
    rested = world.state()
    for spec in CUPS.values():
        before, after = placed.object(spec.name).pose, rested.object(spec.name).pose
        assert abs(before.position[2] - spec.height / 2) < 1e-4
        assert np.linalg.norm(after.position - before.position) < 5e-5
        assert after.matrix()[2, 2] > 0.99999


def test_grid_target_lies_flat(world: World) -> None:
    world.place(GRID, (0.6, 0.0))
    pose = world.state().object("grid").pose
    assert abs(pose.position[2] - GRID.height / 2) < 1e-4
    assert pose.matrix()[2, 2] > 0.99999


def test_placing_again_moves_and_remove_takes_away(world: World) -> None:
    versions = [world.scene().version]
    versions.append(world.place(CUP, (0.55, 0.0)).version)
    versions.append(world.place(CUP, (0.65, 0.1)).version)
    np.testing.assert_allclose(world.state().object(CUP.name).pose.position[:2], (0.65, 0.1), atol=1e-4)
    scene = world.remove(CUP.name)
    versions.append(scene.version)
    assert scene.objects == ()
    assert world.state().objects == ()
    versions.append(world.reset(3).version)
    assert len(set(versions)) == 5
    assert world.scene().seed == 3


def test_wrong_placements_are_refused(world: World) -> None:
    world.place(CUP, (0.6, 0.0))
    with pytest.raises(InvalidArgument, match="blue cup is there"):
        world.place(CUPS["red tumbler"], (0.63, 0.0))
    assert [spec.name for spec in world.scene().objects] == [CUP.name]
    with pytest.raises(InvalidArgument, match="the table reaches"):
        world.place(CUPS["red tumbler"], (0.6, 0.64))
    with pytest.raises(InvalidArgument, match="there are: blue cup"):
        world.remove("vase")
    with pytest.raises(ValueError, match="known are cup, tumbler, mug, grid, ball"):
        ObjectSpec("vase", "vase")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"must be twice its radius, 0\.03 m, got 0\.095 m"):
        ObjectSpec("egg", "ball", radius=0.015)


def test_what_is_refused_another_place_stays_where_it_was(world: World) -> None:
    world.place(CUP, (0.6, 0.0))
    world.place(CUPS["red tumbler"], (0.7, 0.1))
    before, version = world.state().object(CUP.name).pose, world.scene().version
    with pytest.raises(InvalidArgument, match="red tumbler is there"):
        world.place(CUP, (0.7, 0.1))
    with pytest.raises(InvalidArgument, match="red tumbler is there"):
        world.hold(CUP, Pose(np.array([0.7, 0.1, 0.06]), LEVEL))
    assert world.scene().version == version
    assert np.array_equal(world.state().object(CUP.name).pose.position, before.position)


def test_a_ball_lies_where_it_is_placed(world: World) -> None:
    world.place(BALL, (0.6, 0.0))
    SimulatedRobot(world).advance(2.0)
    np.testing.assert_allclose(world.state().object("ball").pose.position, [0.6, 0.0, 0.015], atol=1e-4)


def test_what_is_held_stays_in_the_air(world: World) -> None:
    pose = Pose(np.array([0.8, 0.1, 0.4]), np.array([0.5, -0.5, 0.1, 0.7]))
    version = world.place(CUPS["red tumbler"], (0.7, 0.1)).version
    scene = world.hold(CUP, pose)
    assert scene.version > version
    assert [spec.name for spec in scene.objects] == ["red tumbler", CUP.name]
    assert world.time == pytest.approx(0.2)
    held = world.state()
    assert held.scene_version == scene.version
    SimulatedRobot(world).advance(1.0)
    for state in (held, world.state()):
        there = state.object(CUP.name).pose
        assert np.array_equal(there.position, pose.position)
        np.testing.assert_allclose(there.orientation, pose.orientation, atol=1e-15)
    with pytest.raises(KeyError):
        world.state(0.1).object(CUP.name)


def test_what_is_held_is_felt_and_does_not_give_way(world: World, robot: SimulatedRobot) -> None:
    tool = world.state().tool.position
    world.hold(BALL, Pose(tool, LEVEL))
    assert robot.close_gripper().gripper_opening == pytest.approx(2 * BALL.radius, abs=1e-3)
    ball = world.state().object("ball")
    assert (ball.touches_finger_1, ball.touches_finger_2) == (True, True)
    assert np.array_equal(ball.pose.position, tool)
    assert np.array_equal(ball.pose.orientation, LEVEL)


def test_holding_and_placing_replace_each_other(world: World) -> None:
    world.place(CUP, (0.6, 0.0))
    for position in ([0.6, 0.0, 0.3], [0.6, 0.0, 0.31]):
        assert world.hold(CUP, Pose(np.array(position), LEVEL)).objects == (CUP,)
        assert np.array_equal(world.state().object(CUP.name).pose.position, position)
    assert world.place(CUP, (0.6, 0.05)).objects == (CUP,)
    np.testing.assert_allclose(world.state().object(CUP.name).pose.position, [0.6, 0.05, CUP.height / 2], atol=1e-4)
    world.hold(CUP, Pose(np.array([0.6, 0.0, CUP.height / 2]), LEVEL))  # touches the table, is not in it
    assert world.remove(CUP.name).objects == ()
    assert world.state().objects == ()
    world.hold(CUP, Pose(np.array([0.6, 0.0, 0.3]), LEVEL))
    assert world.reset(0).objects == ()
    assert world.state().objects == ()


@pytest.mark.parametrize(
    ("position", "orientation", "message"),
    [
        ([0.6, 0.0, np.nan], LEVEL, "position of 'grid' must be 3 finite numbers"),
        ([0.6, 0.0], LEVEL, "position of 'grid' must be 3 finite numbers"),
        ([0.6, 0.0, 1e308], LEVEL, "the lab reaches 4 m"),
        ([0.6, 0.0, 0.5], [0.0, 0.0, 0.0, np.inf], "orientation of 'grid' must be 4 finite numbers"),
        ([0.6, 0.0, 0.5], [0.0, 0.0, 1.0], "orientation of 'grid' must be 4 finite numbers"),
        ([0.6, 0.0, 0.5], [0.0, 0.0, 0.0, 1.00001], "a unit quaternion .*, got one of length 1.00001"),
        ([0.6, 0.0, 0.5], [0.0, 0.0, 0.0, 0.0], "a unit quaternion .*, got one of length 0"),
        ([0.6, 0.0, 0.5], [1e308, 1e308, 0.0, 0.0], "a unit quaternion .*, got one of length 1.41"),
        ([0.9, 0.3, 0.5], LEVEL, "blue cup is there"),
        (puma.BASE_POSITION.tolist(), LEVEL, "the robot is there"),
        ([0.35, 0.0, 0.2], LEVEL, "the robot is there"),
        ([0.6, 0.0, 0.1], [0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)], "the table is there"),
        ([0.6, 0.0, 0.0025], LEVEL, "the table is there"),
        ([2.0, 0.0, puma.FLOOR], LEVEL, "the floor is there"),
    ],
)
def test_wrong_poses_to_hold_something_at_are_refused(
    world: World, position: list[float], orientation: list[float], message: str
) -> None:
    world.hold(CUP, Pose(np.array([0.9, 0.3, 0.5]), LEVEL))
    before = world.scene()
    with pytest.raises(InvalidArgument, match=message):
        world.hold(GRID, Pose(np.array(position), np.array(orientation)))
    assert world.scene() == before
    assert [item.name for item in world.state().objects] == [CUP.name]


def test_a_quaternion_that_is_nearly_of_unit_length_is_normalised(world: World) -> None:
    world.hold(BALL, Pose(np.array([0.6, 0.0, 0.5]), np.array([0.6, 0.0, 0.0, 0.8]) * (1 + 5e-7)))
    held = world.state().object("ball").pose
    np.testing.assert_allclose(held.orientation, [0.6, 0.0, 0.0, 0.8], atol=1e-15)


def test_history_is_exact_to_the_step_and_knows_its_ends(world: World) -> None:
    SimulatedRobot(world).move_to_joints(grasping.PARK + np.array([0.2, 0, 0, 0, 0, 0]))
    now = world.state()
    assert now.world_time == world.time
    past = world.state(0.5)
    assert past.world_time == 0.5
    assert grasping.PARK[0] < past.joints[0] < now.joints[0]
    states = world.history(0.1, 0.3, every=0.05)
    np.testing.assert_allclose([s.world_time for s in states], [0.1, 0.15, 0.2, 0.25, 0.3], atol=STEP / 2)
    assert len(world.history(0.0)) == round(world.time / STEP) + 1
    with pytest.raises(InvalidArgument, match="is not known"):
        world.state(world.time + 0.1)


def test_history_keeps_the_scene_of_its_time(world: World) -> None:
    before = world.scene().version
    world.place(CUP, (0.6, 0.0))
    assert world.state().scene_version == world.scene().version > before
    world.remove(CUP.name)
    assert world.state(0.1).object(CUP.name).name == CUP.name


def test_reset_and_place_are_busy_during_a_motion(world: World) -> None:
    world.start_motion(grasping.PARK + 0.1, speed_share=0.5, acceleration_share=0.5)
    world.step()
    with pytest.raises(Busy):
        world.reset(0)
    with pytest.raises(Busy):
        world.place(CUP, (0.6, 0.0))
    with pytest.raises(Busy):
        world.hold(BALL, Pose(np.array([0.6, 0.0, 0.5]), LEVEL))
    with pytest.raises(Busy):
        world.start_gripper(opening=True)


def test_masses_inertias_and_torques_are_the_published_ones(world: World) -> None:
    stage = world._physics.stage
    for i in range(6):
        info = pybullet.getDynamicsInfo(stage.robot, i, physicsClientId=stage.client)
        assert info[0] == pytest.approx(puma.MASS[i])
        np.testing.assert_allclose(info[2], puma.INERTIA[i])
        joint = pybullet.getJointInfo(stage.robot, i, physicsClientId=stage.client)
        np.testing.assert_allclose(joint[8:12], (puma.LOWER[i], puma.UPPER[i], puma.TORQUE[i], puma.SPEED[i]))


def test_friction_product_is_at_most_a_half(world: World) -> None:
    for index, spec in enumerate([*CUPS.values()]):
        world.place(spec, (0.5 + 0.12 * (index % 3), 0.2 * (index // 3) - 0.1))
    stage = world._physics.stage
    robot = max(pybullet.getDynamicsInfo(stage.robot, link, physicsClientId=stage.client)[1] for link in range(-1, 9))
    for body in stage.objects.values():
        assert robot * pybullet.getDynamicsInfo(body, -1, physicsClientId=stage.client)[1] <= 0.5


def test_fingers_stay_coupled(world: World, robot: SimulatedRobot) -> None:
    robot.close_gripper()
    for state in world.history(0.0):
        assert abs(state.fingers[0] - state.fingers[1]) < 5e-4
    assert world.state().fingers.max() < 5e-4
    stage = world._physics.stage
    info = pybullet.getConstraintInfo(pybullet.getConstraintUniqueId(0, physicsClientId=stage.client), stage.client)
    assert {info[1], info[3]} == {FINGER_1, FINGER_2}


def test_close_may_be_called_twice() -> None:
    world = World(Profile.named("ideal"))
    world.close()
    world.close()
    with pytest.raises(Exception, match="closed"):
        world.step()
