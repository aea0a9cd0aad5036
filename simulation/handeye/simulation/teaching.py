"""What a person does in the laboratory of a running stack: show sequences, put objects down."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Event
from typing import cast

from rich.console import Console

from handeye.cli import CliError, state
from handeye.cli.progress import progress
from handeye.client import Client
from handeye.client.connection import find
from handeye.robot_bridge.remote import RemoteRobot
from handeye.rpc import Bus, BusSettings, LabBusSettings
from handeye.rpc.errors import Cancelled
from handeye.rpc.process import until_stopped
from handeye.simulation.lab import LabClient
from handeye.simulation.lessons import LESSONS
from handeye.simulation.objects import CATALOGUE, CUPS, ObjectSpec
from handeye.simulation.places import Purpose, generator
from handeye.simulation.teacher import Teacher


def teach(
    *,
    demonstrations: int,
    seed: int,
    task: str,
    object_name: str,
    state_dir: Path | None,
    watch_parent: bool,
    lesson: str = "grasp",
) -> None:
    """Shows `demonstrations` sequences of a lesson, as `task`, to a running stack (see `joined`) and trains it.

    Ends early, with the arm braked, by `Cancelled`: on TERM, on Ctrl-C, and with `watch_parent` when stdin ends.
    """
    shown = LESSONS[lesson](_catalogued(object_name, CUPS))
    with ExitStack() as opened:
        stop = opened.enter_context(until_stopped(watch_parent))
        robot, lab, client = opened.enter_context(joined(state_dir))
        bar = opened.enter_context(progress(Console(stderr=True)))
        teacher = Teacher(robot, lab, client, shown, task, lambda _share: check(stop))
        teacher.register_objects(seed)
        motions = generator(seed, Purpose.MOTIONS)
        work = bar.add_task(f"teaching {task!r}", total=demonstrations)
        for places in shown.draw(seed, Purpose.TEACHING, demonstrations):
            teacher.demonstrate(places, motions, lambda: check(stop))
            bar.advance(work)
        client.train(task)


def place(
    *,
    object_name: str,
    at: tuple[float, float],
    seed: int,
    state_dir: Path | None,
    beside: tuple[str, float, float] | None = None,
    liquid: int = 0,
) -> None:
    """Sets the laboratory up for the next run: arm parked and free to move, the object at `at`, (x, y) in m.

    `beside`: another object, by name, and its x and y; else it is alone. `liquid`: so many particles are in the object.
    """
    placed = [(_catalogued(object_name, CATALOGUE), at)]
    if beside is not None:
        name, x, y = beside
        placed.append((_catalogued(name, CATALOGUE), (x, y)))
    with joined(state_dir) as (robot, lab, _client):
        lab.reset(seed)
        for spec, where in placed:
            lab.place(spec, where, yaw=0.0)
        if liquid:
            lab.fill(object_name, liquid)
        if robot.state().stopped:
            robot.reset()


def _catalogued(object_name: str, catalogue: Mapping[str, ObjectSpec]) -> ObjectSpec:
    if object_name not in catalogue:
        raise CliError(f"there is no {object_name!r} in the catalogue; there are: {', '.join(catalogue)}")
    return catalogue[object_name]


@contextmanager
def joined(state_dir: Path | None) -> Iterator[tuple[RemoteRobot, LabClient, Client]]:
    """The robot, the laboratory and the coordinator of the stack of `state_dir`.

    Without one, the settings in the environment say where they are if HANDEYE_LAB_BUS_ENDPOINT is among them, else the
    default state directory.
    """
    if state_dir is None and "HANDEYE_LAB_BUS_ENDPOINT" in os.environ:
        acting, lab, (url, token) = BusSettings(), LabBusSettings(), find()
    else:
        directory = state_dir if state_dir is not None else state.default_state_dir()
        server = state.read_private(directory / state.SERVER_FILE)
        buses = cast("dict[str, dict[str, str]]", state.read_private(directory / state.LAB_FILE))
        acting, lab = acting_settings(buses["acting"]), lab_settings(buses["lab"])
        url, token = str(server["url"]), str(server["token"])
    with (
        Bus.open(acting, name="teacher") as bus,
        Bus.open(lab, name="teacher") as lab_bus,
        Client(url, token) as client,
    ):
        yield RemoteRobot(bus, holder="teacher"), LabClient(lab_bus), client


def check(stop: Event) -> None:
    """`Cancelled` once `stop` is set."""
    if stop.is_set():
        raise Cancelled("the teacher was told to stop")


def acting_settings(environment: Mapping[str, str]) -> BusSettings:
    """The acting bus's settings from the environment variables that a stack hands out."""
    return BusSettings.model_validate(_fields(environment, "HANDEYE_BUS_"))


def lab_settings(environment: Mapping[str, str]) -> LabBusSettings:
    """The lab bus's settings from the environment variables that a stack hands out."""
    return LabBusSettings.model_validate(_fields(environment, "HANDEYE_LAB_BUS_"))


def _fields(environment: Mapping[str, str], prefix: str) -> dict[str, str]:
    return {key.removeprefix(prefix).lower(): value for key, value in environment.items()}
