"""The simulated gripper lets go at once, also while the arm brakes."""

from __future__ import annotations

import numpy as np
import pytest

from handeye.robot_bridge.drivers.simulated import SimulatedRobot
from handeye.rpc.errors import Slipping
from handeye.simulation import grasping
from handeye.simulation.objects import CUPS
from handeye.simulation.world import World

AWAY = grasping.PARK + np.array([0.3, 0.1, 0.1, 0.2, -0.1, 0.4])


def test_what_slips_is_let_go_while_the_arm_brakes(world: World, robot: SimulatedRobot) -> None:
    robot.close_gripper()
    opened: list[float] = []

    def watch(fraction: float) -> None:
        if fraction > 0.3:
            opened.append(world.time)
            raise Slipping("the gripper has closed further")

    with pytest.raises(Slipping):
        robot.move_to_joints(AWAY, watch=watch)
    state = robot.state()
    assert (state.moving, state.stopped) == (False, False)
    assert state.gripper_opening == pytest.approx(robot.description.gripper_range, abs=2e-3)
    assert np.abs(state.joints - AWAY).max() > 0.05
    in_time = world.state(opened[0] + 0.1)
    assert in_time.fingers.sum() > 0.01  # long before the arm stands still


def test_a_grip_is_let_go_at_once(world: World, robot: SimulatedRobot) -> None:
    world.place(CUPS["blue cup"], (0.55, 0.0))
    chain = grasping.solve_chain(np.array([0.55, 0.0]))
    for goal in ("approach", "grasp"):
        robot.move_to_joints(chain[goal])
    held = robot.close_gripper()
    robot.open_gripper()
    after = world.state(held.world_time + 0.1)
    assert after.fingers.sum() > held.gripper_opening + 0.008
