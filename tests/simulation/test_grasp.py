"""Grasping is by contact and friction alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pybullet
import pytest

from handeye.robot_bridge.drivers.simulated import SimulatedRobot
from handeye.simulation import grasping
from handeye.simulation.gripper import PAD_FRICTION
from handeye.simulation.objects import CUPS, FRICTION
from handeye.simulation.scene import FINGER_1, FINGER_2
from handeye.simulation.world import World

from .conftest import MakeWorld

CUP = CUPS["blue cup"]
Lift = Callable[..., float]


def places(seed: int, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Random places in the workspace, and where they are believed to be: exact, or 8 mm off."""
    rng = np.random.default_rng(seed)
    result = []
    for index in range(count):
        place = np.array([0.6, 0.0]) + rng.uniform(-0.15, 0.15, 2)
        angle = rng.uniform(0, 2 * np.pi)
        off = 0.008 * np.array([np.cos(angle), np.sin(angle)]) * (index % 2)
        result.append((place, place + off))
    return result


@pytest.mark.parametrize("profile", ["ideal", "default"])
def test_cups_are_lifted_and_held_anywhere(make_world: MakeWorld, lift: Lift, profile: str) -> None:
    world = make_world(profile)
    for (place, believed), spec in zip(places(1, 6), CUPS.values(), strict=True):
        world.reset()
        world.place(spec, place)
        assert lift(world, spec, believed) > 0.10, spec.name
        state = world.state().object(spec.name)
        assert state.touches_finger_1
        assert state.touches_finger_2


def test_below_coulombs_limit_the_cup_drops(make_world: MakeWorld, lift: Lift) -> None:
    limit = CUP.mass * 9.81 / (2 * PAD_FRICTION * FRICTION)
    for share in (0.5, 0.9):
        world = make_world(grip_force=share * limit)
        world.place(CUP, (0.6, 0.02))
        assert lift(world, CUP, np.array([0.6, 0.02])) < 0.05


def test_nothing_holds_the_cup_but_the_fingers(world: World, robot: SimulatedRobot) -> None:
    world.place(CUP, (0.62, -0.05))
    chain = grasping.solve_chain(np.array([0.62, -0.05]))
    for name in ("approach", "grasp"):
        robot.move_to_joints(chain[name])
    robot.close_gripper()
    robot.move_to_joints(chain["lift"])
    assert world.state().object(CUP.name).pose.position[2] > 0.18
    stage = world._physics.stage
    client = stage.client
    for index in range(pybullet.getNumConstraints(physicsClientId=client)):
        info = pybullet.getConstraintInfo(
            pybullet.getConstraintUniqueId(index, physicsClientId=client), physicsClientId=client
        )
        assert (info[0], info[2]) == (stage.robot, stage.robot)
        assert {info[1], info[3]} == {FINGER_1, FINGER_2}
        assert info[4] == pybullet.JOINT_GEAR
    # Opened, it falls.
    robot.open_gripper()
    robot.advance(1.0)
    state = world.state().object(CUP.name)
    assert state.pose.position[2] < 0.1
    assert not state.touches_finger_1
    assert not state.touches_finger_2


def test_a_held_cup_does_not_slip(world: World, robot: SimulatedRobot) -> None:
    world.place(CUP, (0.55, 0.1))
    chain = grasping.solve_chain(np.array([0.55, 0.1]))
    for name in ("approach", "grasp"):
        robot.move_to_joints(chain[name])
    robot.close_gripper()
    robot.advance(3.0)  # long enough for a body at rest to fall asleep

    def in_hand() -> np.ndarray:
        state = world.state()
        tool = state.tool.matrix()
        offset: np.ndarray = tool[:3, :3].T @ (state.object(CUP.name).pose.position - tool[:3, 3])
        return offset

    before = in_hand()
    robot.move_to_joints(chain["lift"])
    robot.advance(2.0)
    assert np.linalg.norm(in_hand() - before) < 3.5e-4


def test_the_way_from_park_leaves_a_cup_alone_anywhere(world: World, robot: SimulatedRobot) -> None:
    for x in (0.45, 0.60, 0.75):
        for y in (-0.15, 0.0, 0.15):
            world.reset()
            world.place(CUP, (x, y))
            chain = grasping.solve_chain(np.array([x, y]))
            robot.move_to_joints(chain["approach"])
            robot.move_to_joints(chain["grasp"])
            position = world.state().object(CUP.name).pose.position
            assert np.linalg.norm(position[:2] - (x, y)) < 2e-4
