"""What goes wrong in a world goes wrong by physics, once, at the same moment every time."""

from __future__ import annotations

import numpy as np
import pytest

from handeye.robot_bridge.drivers.simulated import SimulatedRobot
from handeye.simulation import grasping
from handeye.simulation.conditions import Conditions
from handeye.simulation.objects import CUPS
from handeye.simulation.world import World

CUP = CUPS["blue cup"]
PLACE = np.array([0.6, 0.04])


def cup_after(world: World, robot: SimulatedRobot, *subtasks: str) -> np.ndarray:
    chain = grasping.solve_chain(PLACE)
    for name in subtasks:
        robot.move_to_joints(chain[name])
        if name == "grasp":
            robot.close_gripper()
    robot.advance(1.0)
    return world.state().object(CUP.name).pose.position


def test_the_cup_is_pushed_once_the_hand_is_before_it(world: World, robot: SimulatedRobot) -> None:
    world.reset(1, Conditions(push=(0.03, -0.02)))
    world.place(CUP, PLACE)
    robot.advance(1.0)  # the hand is far away
    assert world.state().object(CUP.name).pose.position[:2] == pytest.approx(PLACE, abs=1e-3)
    pushed = cup_after(world, robot, "approach")
    assert pushed[:2] == pytest.approx(PLACE + np.array([0.03, -0.02]), abs=6e-3)
    assert pushed[2] == pytest.approx(CUP.height / 2, abs=1e-3)
    assert cup_after(world, robot) == pytest.approx(pushed, abs=1e-4)  # it was pushed once


@pytest.mark.parametrize(("slip", "lowest", "highest"), [(0.0, 0.18, 0.21), (0.1, 0.14, 0.195), (2.0, 0.0, 0.06)])
def test_a_cup_slips_in_the_hand_or_out_of_it(
    world: World, robot: SimulatedRobot, slip: float, lowest: float, highest: float
) -> None:
    world.reset(1, Conditions(slip=slip))
    world.place(CUP, PLACE)
    assert lowest < cup_after(world, robot, "approach", "grasp", "lift")[2] < highest
