"""Worlds for the tests of the lab; every one is closed again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Protocol

import numpy as np
import pytest

from handeye.robot_bridge.drivers.simulated import SimulatedRobot
from handeye.simulation import grasping
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.profile import Profile
from handeye.simulation.world import Clock, World


class MakeWorld(Protocol):
    def __call__(
        self, profile: str = "ideal", seed: int = 0, clock: Clock = "lockstep", grip_force: float = 15.0
    ) -> World: ...


@pytest.fixture
def make_world() -> Iterator[MakeWorld]:
    with ExitStack() as stack:

        def make(profile: str = "ideal", seed: int = 0, clock: Clock = "lockstep", grip_force: float = 15.0) -> World:
            return stack.enter_context(World(Profile.named(profile), seed, clock, grip_force=grip_force))

        yield make


@pytest.fixture
def world(make_world: MakeWorld) -> World:
    return make_world()


@pytest.fixture
def robot(world: World) -> SimulatedRobot:
    return SimulatedRobot(world)


@pytest.fixture
def lift() -> Callable[..., float]:
    """Grasps an object where it is believed to stand, lifts it, and says how high it stayed for 2 s, in m."""

    def run(world: World, spec: ObjectSpec, believed: np.ndarray) -> float:
        robot = SimulatedRobot(world)
        chain = grasping.solve_chain(believed, spec.height / 2)
        robot.move_to_joints(chain["approach"])
        robot.move_to_joints(chain["grasp"])
        robot.close_gripper()
        robot.move_to_joints(chain["lift"])
        robot.advance(2.5)
        heights = [s.object(spec.name).pose.position[2] for s in world.history(world.time - 2.0, every=0.1)]
        return float(min(heights) - spec.height / 2)

    return run
