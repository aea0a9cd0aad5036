"""Every pair of cameras and head that keeps the camera drivers' contract: fake, simulated, and either over the bus."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass
from typing import Literal

from handeye.camera_bridge.driver import CameraDriver, HeadDriver
from handeye.camera_bridge.drivers.simulated import connect
from handeye.camera_bridge.remote import RemoteCameras, RemoteHead
from handeye.camera_bridge.service import CameraService
from handeye.robot_bridge.drivers.simulated import SimulatedRobot
from handeye.robot_bridge.remote import RemoteRobot
from handeye.robot_bridge.service import RobotService
from handeye.rpc import Bus, BusSettings, LabBusSettings
from handeye.simulation.lab import LabService
from handeye.simulation.profile import Profile
from handeye.simulation.world import World
from tests.camera_bridge.fake_cameras import FakeCameras, FakeClock, FakeHead


@dataclass(frozen=True)
class Eyes:
    """Cameras and head, the lease under which the head may turn, its heartbeat, and how to let world time pass."""

    cameras: CameraDriver
    head: HeadDriver
    lease_id: str
    beat: Callable[[], None]
    advance: Callable[[float], object]


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def ending_what_it_starts() -> Iterator[None]:
    """Fails when threads are left running: for modules whose drivers, and their workers, live as long as the module."""
    before = set(threading.enumerate())
    yield
    deadline = time.monotonic() + 3.0
    while left := [t.name for t in set(threading.enumerate()) - before if not isinstance(t, threading._DummyThread)]:
        assert time.monotonic() < deadline, f"the module left these running: {left}"
        time.sleep(0.02)


@contextmanager
def fake() -> Iterator[Eyes]:
    clock = FakeClock()
    head = FakeHead(clock)
    yield Eyes(FakeCameras(clock, head), head, "", lambda: None, clock.advance)


@dataclass(frozen=True)
class Lab:
    """A simulated world with its two buses in this process."""

    world: World
    lab: LabBusSettings
    acting: BusSettings
    robot: RemoteRobot


@contextmanager
def lab(profile: str = "default", clock: Literal["lockstep", "realtime"] = "lockstep") -> Iterator[Lab]:
    """The robot bridge's side, its lease held by the test."""
    acting = BusSettings(endpoint=free_endpoint())
    hosted = LabBusSettings(endpoint=free_endpoint())
    with (
        Bus.host(acting, {}),
        World(Profile.named(profile), seed=3, clock=clock) as world,
        Bus.host(hosted, {}) as lab_bus,
        LabService(world, lab_bus),
        closing(SimulatedRobot(world)) as driver,
        Bus.open(acting, "robot-bridge") as robot_bus,
        RobotService(driver, robot_bus),
        Bus.open(acting, "test") as bus,
        closing(RemoteRobot(bus, "test")) as robot,
        robot.lease(),
    ):
        yield Lab(world, hosted, acting, robot)


@contextmanager
def eyes_of(there: Lab) -> Iterator[Eyes]:
    """The simulated drivers on a lab."""
    with (
        Bus.open(there.acting, "camera-bridge") as bus,
        connect(there.lab, bus, 5.0, threading.Event()) as (cameras, head),
    ):
        yield Eyes(cameras, head, there.robot.lease_id, there.robot.beat, there.robot.advance)


@contextmanager
def simulated() -> Iterator[Eyes]:
    with lab() as there, eyes_of(there) as eyes:
        eyes.advance(0.1)
        yield eyes


@contextmanager
def over_the_bus(made: Callable[[], AbstractContextManager[Eyes]]) -> Iterator[Eyes]:
    """The drivers behind the camera bridge's service, as a client on a router sees them."""
    settings = BusSettings(endpoint=free_endpoint())
    with (
        made() as served,
        Bus.host(settings, {}),
        Bus.open(settings, "camera-bridge") as bridge,
        CameraService(served.cameras, served.head, bridge),
        Bus.open(settings, "contract") as bus,
    ):
        yield Eyes(RemoteCameras(bus), RemoteHead(bus), served.lease_id, served.beat, served.advance)


EYES: dict[str, Callable[[], AbstractContextManager[Eyes]]] = {
    "fake": fake,
    "simulated": simulated,
    "remote-fake": lambda: over_the_bus(fake),
    "remote-simulated": lambda: over_the_bus(simulated),
}
