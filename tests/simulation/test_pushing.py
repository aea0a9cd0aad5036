"""A cup that somebody pushes along the table."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from handeye.robot_bridge.drivers.simulated import SimulatedRobot
from handeye.rpc.errors import InvalidArgument
from handeye.simulation import grasping
from handeye.simulation.objects import CUPS
from handeye.simulation.pose import Pose
from handeye.simulation.pushing import ACCELERATION
from handeye.simulation.scene import STEP
from handeye.simulation.world import World

CUP = CUPS["blue cup"]
START = (0.6, 0.0)
PATH = [(0.7, 0.0), (0.7, 0.15)]
SPEED = 0.1


def positions(world: World, since: float) -> NDArray[np.float64]:
    return np.array([state.object(CUP.name).pose.position for state in world.history(since)])


def test_it_goes_evenly_along_the_path_and_stands_there_upright(world: World) -> None:
    world.place(CUP, START)
    begun = world.time
    ends = world.push(CUP.name, PATH, SPEED)
    assert ends - begun == pytest.approx(0.25 / SPEED + SPEED / ACCELERATION, abs=0.01)
    SimulatedRobot(world).advance(ends - begun + 0.5)
    way = positions(world, begun)
    steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
    # Where its speed is even it makes its way, but for the corner and the friction of a step.
    middle = steps[round(0.5 / STEP) : round(2.0 / STEP)]
    assert np.median(middle) == pytest.approx(SPEED * STEP, rel=0.02)
    assert steps.max() <= SPEED * STEP * 1.5
    assert steps[: round(0.05 / STEP)].max() < 0.3 * SPEED * STEP
    on_first, on_second = np.abs(way[:, 1]) < 3e-4, np.abs(way[:, 0] - 0.7) < 3e-4
    assert (on_first | on_second).all()
    last = world.state().object(CUP.name).pose
    np.testing.assert_allclose(last.position, [0.7, 0.15, CUP.height / 2], atol=5e-4)
    np.testing.assert_allclose(np.abs(last.orientation), [0.0, 0.0, 0.0, 1.0], atol=1e-3)
    rested = world.state(ends + 0.1).object(CUP.name).pose.position
    np.testing.assert_allclose(rested, last.position, atol=1e-5)


def test_the_same_push_gives_the_same_bits(world: World) -> None:
    ways = []
    for _ in range(2):
        world.reset(4)
        world.place(CUP, START, yaw=0.3)
        world.push(CUP.name, PATH, SPEED)
        SimulatedRobot(world).advance(1.0)
        ways.append(positions(world, 0.3))
    assert np.array_equal(ways[0], ways[1])


def test_a_push_replaces_the_one_before_and_ends_with_its_object(world: World) -> None:
    robot = SimulatedRobot(world)
    world.place(CUP, START)
    world.push(CUP.name, PATH, SPEED)
    robot.advance(0.5)
    ends = world.push(CUP.name, [START], SPEED)
    robot.advance(ends - world.time + 0.1)
    np.testing.assert_allclose(world.state().object(CUP.name).pose.position[:2], START, atol=5e-4)
    for number in range(2):
        world.push(CUP.name, PATH, SPEED)
        if number == 0:
            world.place(CUP, (0.5, 0.1))
        else:
            world.hold(CUP, Pose(np.array([0.5, 0.1, 0.3]), np.array([0.0, 0.0, 0.0, 1.0])))
        robot.advance(0.5)
        np.testing.assert_allclose(world.state().object(CUP.name).pose.position[:2], (0.5, 0.1), atol=5e-4)
    world.remove(CUP.name)
    world.reset(1)
    robot.advance(0.1)


def test_who_touches_it_ends_the_push(world: World) -> None:
    robot = SimulatedRobot(world)
    chain = grasping.solve_chain(np.array(START))
    world.place(CUP, START)
    robot.move_to_joints(chain["approach"])
    robot.move_to_joints(chain["grasp"])
    world.push(CUP.name, [(0.7, 0.0)], 0.005)
    robot.close_gripper()
    held = world.state().object(CUP.name).pose.position
    with pytest.raises(InvalidArgument, match="the robot is there"):
        world.push(CUP.name, [(0.45, 0.0)], 0.05)
    robot.advance(2.0)
    np.testing.assert_allclose(world.state().object(CUP.name).pose.position, held, atol=1e-3)


@pytest.mark.parametrize(
    ("path", "speed", "message"),
    [
        ([], 0.1, "finite places"),
        ([(0.7, np.nan)], 0.1, "finite places"),
        ([(0.7, 0.0)], 0.0, "more than 0"),
        ([(0.7, 0.0)], np.nan, "more than 0"),
        ([(0.7, 0.0)], 0.6, r"at most 0.5 m/s"),
        ([(1.2, 0.0)], 0.1, "the table reaches"),
        ([(0.9, 0.0)], 0.1, "red tumbler is there"),
        ([(0.7, 0.0), (0.6, 0.0)] * 60, 0.1, "10 m at most"),
    ],
)
def test_where_it_cannot_go_it_is_not_pushed(
    world: World, path: list[tuple[float, float]], speed: float, message: str
) -> None:
    world.place(CUP, START)
    world.place(CUPS["red tumbler"], (0.8, 0.0))
    before = world.state().object(CUP.name).pose.position
    with pytest.raises(InvalidArgument, match=message):
        world.push(CUP.name, path, speed)
    SimulatedRobot(world).advance(0.2)
    np.testing.assert_allclose(world.state().object(CUP.name).pose.position, before, atol=1e-5)
    with pytest.raises(InvalidArgument, match="there are: blue cup"):
        world.push("vase", [(0.6, 0.1)], 0.1)
