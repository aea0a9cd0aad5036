"""The robot bridge as a process: opens the robot that the settings name and serves it until it is told to stop."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager

import structlog

from handeye.robot_bridge.driver import RobotDriver
from handeye.robot_bridge.service import RobotService
from handeye.robot_bridge.settings import RobotBridgeSettings
from handeye.rpc import Bus, BusSettings, LabBusSettings
from handeye.rpc.errors import Unauthorised

_log = structlog.get_logger()

ROUTER_TIMEOUT = 10.0
"""Seconds to wait for the router: processes that start together are not ready together."""


class MissingExtra(Exception):
    """A driver needs a package that is not installed; the message names the extra to install."""


def run(settings: RobotBridgeSettings, stop: threading.Event) -> None:
    """Serves the robot until `stop` is set. Raises `MissingExtra`, and what `Bus.open` and `Bus.host` raise."""
    with (
        open_robot(settings) as robot,
        Bus.open(BusSettings(), name="robot-bridge", timeout=ROUTER_TIMEOUT) as bus,
        RobotService(robot, bus),
    ):
        _log.info("robot bridge serves", **settings.model_dump())
        stop.wait()


def lab_credentials(lab: LabBusSettings) -> dict[str, str]:
    """Who may join the lab bus, with the password. It tells the truth about the world, so `Unauthorised` for nobody."""
    password = lab.password.get_secret_value()
    if not (lab.user and password):
        raise Unauthorised(
            "the lab bus needs a user and a password of its own, so that nothing that acts can read the truth there: "
            "set HANDEYE_LAB_BUS_USER and HANDEYE_LAB_BUS_PASSWORD"
        )
    return {lab.user: password}


@contextmanager
def open_robot(settings: RobotBridgeSettings) -> Iterator[RobotDriver]:
    """The driver that the settings name, closed at the end; the simulated one comes with its lab bus.

    Raises `MissingExtra`, and `Unauthorised` when the lab bus has no credentials of its own.
    """
    # Only here and only now: a bridge with a hardware driver needs no simulator.
    try:
        from handeye.robot_bridge.drivers.simulated import SimulatedRobot
        from handeye.simulation.lab import LabService
        from handeye.simulation.profile import Profile
        from handeye.simulation.world import World
    except ModuleNotFoundError as error:
        raise MissingExtra(
            f"the simulated robot needs {error.name!r}, which is not installed: pip install 'handeye[robot]', "
            "on CPython 3.11 (the simulator's wheels exist for no later one)"
        ) from error

    lab = LabBusSettings()
    credentials = lab_credentials(lab)
    with (
        closing(World(Profile.named(settings.profile), seed=settings.seed, clock=settings.clock)) as world,
        closing(SimulatedRobot(world)) as robot,
        Bus.host(lab, credentials) as lab_bus,
        LabService(world, lab_bus),
    ):
        yield robot
