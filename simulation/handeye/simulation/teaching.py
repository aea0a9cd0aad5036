"""The teacher's process: from a state directory to shown sequences."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from threading import Event
from typing import cast

from rich.console import Console

from handeye.cli import CliError, state
from handeye.cli.progress import progress
from handeye.client import Client
from handeye.robot_bridge.remote import RemoteRobot
from handeye.rpc import Bus, BusSettings, LabBusSettings
from handeye.rpc.errors import Cancelled
from handeye.rpc.process import until_stopped
from handeye.simulation.lab import LabClient
from handeye.simulation.objects import CUPS
from handeye.simulation.places import Purpose, draw, generator
from handeye.simulation.teacher import Teacher, looks_per_demonstration


def teach(
    *, demonstrations: int, seed: int, task: str, object_name: str, state_dir: Path | None, watch_parent: bool
) -> None:
    """Shows `demonstrations` sequences of `task` to the stack of `state_dir` (None: the default one).

    Ends early, with the arm braked, by `Cancelled`: on TERM, on Ctrl-C, and with `watch_parent` when stdin ends.
    """
    if object_name not in CUPS:
        raise CliError(f"there is no {object_name!r} in the catalogue; there are: {', '.join(CUPS)}")
    directory = state_dir if state_dir is not None else state.default_state_dir()
    server = state.read_private(directory / state.SERVER_FILE)
    buses = cast("dict[str, dict[str, str]]", state.read_private(directory / state.LAB_FILE))
    with ExitStack() as opened:
        stop = opened.enter_context(until_stopped(watch_parent))
        bus = opened.enter_context(Bus.open(acting_settings(buses["acting"]), name="teacher"))
        lab_bus = opened.enter_context(Bus.open(lab_settings(buses["lab"]), name="teacher"))
        client = opened.enter_context(Client(str(server["url"]), str(server["token"])))
        bar = opened.enter_context(progress(Console(stderr=True)))
        robot = RemoteRobot(bus, holder="teacher")
        teacher = Teacher(robot, LabClient(lab_bus), client, CUPS[object_name], task, lambda _share: check(stop))
        teacher.register_object(seed)
        motions = generator(seed, Purpose.MOTIONS)
        work = bar.add_task(f"teaching {task!r}", total=demonstrations * looks_per_demonstration())

        def on_look() -> None:
            check(stop)
            bar.advance(work)

        for place in draw(seed, Purpose.TEACHING, demonstrations):
            teacher.demonstrate(place, motions, on_look)


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
