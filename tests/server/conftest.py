"""A coordinator on the toy world, with a store and over HTTP."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi import FastAPI
from pydantic import SecretStr
from starlette.testclient import TestClient

from handeye.modules.module import warm_up
from handeye.server.access import Access, LimitSettings, Tokens
from handeye.server.app import create_app
from handeye.server.control import Control
from handeye.server.coordinator import Coordinator
from handeye.server.demonstration import Action
from handeye.server.metrics import Metrics
from handeye.server.results import TrainStatistics
from handeye.server.serve import http_server
from handeye.server.settings import ServerSettings
from handeye.server.store import Store
from handeye.server.training import TrainRequest
from tests.server.rest import declaration
from tests.server.toys import JOINTS, LATENCY, PARK, ToyCameras, ToyHead, ToyRobot, ToySight, World

TOKEN = "a-token-for-tests"


Part = tuple[str, float, Action | None]
"""A subtask as it is shown: its name, how many rad above the cup it ends, what the gripper does then."""
GRASP: tuple[Part, ...] = (("grasp", 0.0, "close_gripper"), ("lift", -0.4, None))


@dataclass
class Lab:
    """The toy world and a coordinator on it."""

    world: World
    robot: ToyRobot
    cameras: ToyCameras
    sight: ToySight
    coordinator: Coordinator
    missing: list[str]
    places: list[tuple[float, float]]
    access: Access

    def app(self) -> FastAPI:
        """The application, whose configured token is `TOKEN`."""
        return create_app(self.coordinator, self.access)

    def train(self, task: str = "grasp", **options: Any) -> TrainStatistics:
        """Trains a task and waits for it."""
        job = self.coordinator.train_task(task, TrainRequest(**options))
        assert job.wait(30.0)
        result = job.view().result
        assert isinstance(result, TrainStatistics), job.view().error
        return result

    def teach(self, cups: list[tuple[float, float]], task: str = "grasp", parts: tuple[Part, ...] = GRASP) -> None:
        """Shows the task once for each place (row, column) of the cup, with scattered observations."""
        coordinator, world = self.coordinator, self.world
        random = np.random.default_rng(7)
        coordinator.show_object("blue cup", "backgrounds", 0.0)
        coordinator.show_object("blue cup", "examples", 0.0)
        for row, column in cups:
            world.cup = np.array([row, column, 150.0])
            shown = coordinator.demonstrations.begin(task, "blue cup").id
            start = PARK
            for subtask, lift, action in parts:
                goal = world.goal_joints(lift)
                for share in (0.0, 0.5, 0.8, 0.95, 1.0):
                    scatter = random.normal(0.0, 0.02, JOINTS) if 0.0 < share < 1.0 else 0.0
                    world.joints = start + share * (goal - start) + scatter
                    world.time += LATENCY
                    coordinator.observe(shown, subtask, goal=share == 1.0, key=share == 0.0)
                if action is not None:
                    coordinator.demonstrations.act(shown, subtask, action)
                start = goal
            coordinator.demonstrations.finish(shown)
        world.joints = PARK.copy()


PLACES = [(r, c) for r in (200.0, 220.0, 240.0, 260.0, 280.0) for c in (280.0, 320.0, 360.0)]


@pytest.fixture(scope="session", autouse=True)
def compiled() -> None:
    """The kernels are compiled before anything waits for an answer."""
    warm_up()


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with Store.open(f"sqlite:///{tmp_path / 'handeye.db'}") as opened:
        yield opened


@pytest.fixture
def lab(store: Store) -> Iterator[Lab]:
    with open_lab(store) as opened:
        yield opened


@pytest.fixture
def http(lab: Lab) -> Iterator[TestClient]:
    with asking(lab) as client:
        yield client


@pytest.fixture
def url(lab: Lab) -> Iterator[str]:
    """Where the lab's application is served over a real connection."""
    stop = threading.Event()
    with (
        closing(socket.create_server(("127.0.0.1", 0))) as listener,
        http_server(lab.app(), listener, stop),
        closing(lab.coordinator),
    ):
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"


@pytest.fixture
def module(http: TestClient) -> str:
    """Where a module without samples is."""
    return str(http.post("/v1/modules", json=declaration()).headers["location"])


@contextmanager
def asking(lab: Lab) -> Iterator[TestClient]:
    """A client of the lab's application."""
    headers = {"Authorization": f"Bearer {TOKEN}"}
    with TestClient(lab.app(), headers=headers, raise_server_exceptions=False) as client:
        yield client


@contextmanager
def open_lab(store: Store) -> Iterator[Lab]:
    """A toy world, and a coordinator of a store that works in it."""
    world = World(time=1.0)
    robot, cameras, sight = ToyRobot(world), ToyCameras(world), ToySight(world)
    missing: list[str] = []
    control = Control(lambda _holder: robot, ToyHead(world))
    coordinator = Coordinator(store, robot, control, cameras, sight, ServerSettings(), lambda: missing)
    access = Access(Tokens(store, SecretStr(TOKEN)), LimitSettings(), Metrics())
    coordinator.load()
    try:
        yield Lab(world, robot, cameras, sight, coordinator, missing, PLACES, access)
    finally:
        coordinator.close()
