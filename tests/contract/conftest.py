"""Every robot that keeps the `RobotDriver` contract: the fake, the simulated one, and either of them over the bus."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager
from typing import Literal

import pytest

from handeye.robot_bridge.driver import RobotDriver
from handeye.robot_bridge.drivers.simulated import SimulatedRobot
from handeye.robot_bridge.guard import GuardedRobot
from handeye.robot_bridge.remote import RemoteRobot
from handeye.robot_bridge.service import RobotService
from handeye.rpc import Bus, BusSettings
from handeye.simulation.profile import Profile
from handeye.simulation.world import World
from tests.robot_bridge.fake_robot import FakeRobot

Clock = Literal["realtime", "lockstep"]


@contextmanager
def fake(clock: Clock) -> Iterator[RobotDriver]:
    robot = FakeRobot(clock)
    robot.wall_step = max(robot.wall_step, 0.0005)  # a robot whose motions last can be stopped in mid-motion
    with closing(robot):
        yield robot


@contextmanager
def guarded(clock: Clock) -> Iterator[RobotDriver]:
    with fake(clock) as robot:
        yield GuardedRobot(robot)


@contextmanager
def simulated(clock: Clock) -> Iterator[RobotDriver]:
    with (
        closing(World(Profile.named("default"), seed=0, clock=clock)) as world,
        closing(SimulatedRobot(world)) as robot,
    ):
        yield robot


@contextmanager
def remote(served: RobotDriver) -> Iterator[RobotDriver]:
    """`served` behind the robot bridge's service, as a client on a real router sees it."""
    with ExitStack() as stack:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            settings = BusSettings(endpoint=f"tcp/127.0.0.1:{probe.getsockname()[1]}")
        stack.enter_context(Bus.host(settings, {}))
        stack.enter_context(RobotService(served, stack.enter_context(Bus.open(settings, "robot-bridge"))))
        robot = RemoteRobot(stack.enter_context(Bus.open(settings, "contract")), "contract")
        stack.enter_context(robot.lease())
        yield robot


@contextmanager
def over_the_bus(made: Callable[[Clock], AbstractContextManager[RobotDriver]], clock: Clock) -> Iterator[RobotDriver]:
    with made(clock) as served, remote(served) as robot:
        yield robot


ROBOTS: dict[str, Callable[[], AbstractContextManager[RobotDriver]]] = {
    "fake-lockstep": lambda: fake("lockstep"),
    "guarded": lambda: guarded("lockstep"),
    "simulated-lockstep": lambda: simulated("lockstep"),
    "remote-fake-realtime": lambda: over_the_bus(fake, "realtime"),
    "remote-simulated-lockstep": lambda: over_the_bus(simulated, "lockstep"),
}


@pytest.fixture(params=list(ROBOTS))
def robot(request: pytest.FixtureRequest) -> Iterator[RobotDriver]:
    """A robot at park, its gripper open, nothing latched."""
    with ROBOTS[request.param]() as driver:
        yield driver
