"""Where an evaluation takes place: a stack of its own, its coordinator, its laboratory, and a person who helps."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from handeye.cli.progress import counted
from handeye.cli.up import Clock, Stack
from handeye.client import Client, HandeyeError
from handeye.robot_bridge.remote import RemoteRobot
from handeye.rpc import Bus
from handeye.rpc.errors import RpcError
from handeye.simulation.evaluation.outcome import Earlier, Figure, Outcome
from handeye.simulation.experimenter import Experimenter
from handeye.simulation.lab import LabClient
from handeye.simulation.report import Picture
from handeye.simulation.teaching import acting_settings, lab_settings


@dataclass(frozen=True, slots=True)
class Site:
    """A running stack and all who work at it."""

    client: Client
    robot: RemoteRobot
    """For the teacher, who leads the arm by hand."""
    lab: LabClient
    experimenter: Experimenter
    console: Console
    stack: Stack

    def progress(self, title: str, total: int, done: int = 0) -> AbstractContextManager[Callable[[], None]]:
        """A bar; what is given is called for each step done, some of them `done` before."""
        return counted(self.console, title, total, done)

    def teach(self, lesson: str, demonstrations: int, seed: int) -> None:
        """Shows a lesson and trains it: in a process of its own, for its teacher uses truth."""
        child = self.stack.start_verb(
            "teach",
            *("--state-dir", str(self.stack.state_dir), "--seed", str(seed)),
            *("--demonstrations", str(demonstrations), "--lesson", lesson),
            environment={},
            name="teacher",
            logged=False,
        )
        self.stack.supervisor.finish(child)


Trial = dict[str, Any]
"""One trial, as it stands in the JSON."""


@dataclass(frozen=True, slots=True)
class Evaluation:
    """What is measured, and what is made of it."""

    name: str
    title: str
    measure: Callable[[Site, int, int, list[Picture]], list[Trial]]
    """(site, seed, trials, pictures to add to) -> the trials."""
    figures: Callable[[Sequence[Trial]], tuple[Figure, ...]]
    histograms: Callable[[Sequence[Trial]], dict[str, tuple[float, ...]]]
    """Values of single trials, by a caption that names their unit."""
    clock: Clock | None = None
    """The one clock with which it means something; None: any."""

    def report(self, clock: Clock) -> str:
        """Name of its report's files: what was measured in lockstep and in realtime does not belong together."""
        return f"{self.name}-realtime" if self.clock is None and clock is Clock.REALTIME else self.name


def run(
    evaluation: Evaluation,
    seeds: Sequence[int],
    trials: int,
    clock: Clock,
    console: Console,
    earlier: Earlier,
) -> Iterator[Outcome]:
    """Measures for each seed on a stack of its own; after each of them, what the trials so far amount to."""
    started = time.monotonic()
    told: list[Trial] = list(earlier.trials)
    pictures: list[Picture] = []
    for seed in seeds:
        told += [
            {"seed": seed, **trial}
            for trial in _measured(evaluation, seed, trials, evaluation.clock or clock, console, pictures)
        ]
        yield Outcome(
            evaluation.report(clock),
            evaluation.title + (", in realtime" if clock is Clock.REALTIME else ""),
            tuple(dict.fromkeys(trial["seed"] for trial in told)),
            evaluation.figures(told),
            tuple(told),
            evaluation.histograms(told),
            tuple(pictures),
            earlier.seconds + time.monotonic() - started,
        )


def _measured(
    evaluation: Evaluation, seed: int, trials: int, clock: Clock, console: Console, pictures: list[Picture]
) -> list[Trial]:
    with ExitStack() as opened:
        state_dir = Path(opened.enter_context(tempfile.TemporaryDirectory(prefix="handeye-evaluate-")))
        stack = opened.enter_context(Stack(state_dir, clock=clock, console=console))
        client = opened.enter_context(Client(stack.url, stack.token))
        lab = LabClient(opened.enter_context(Bus.open(lab_settings(stack.lab), name="evaluation")))
        bus = opened.enter_context(Bus.open(acting_settings(stack.acting), name="teacher"))
        robot = RemoteRobot(bus, holder="teacher")
        site = Site(client, robot, lab, Experimenter(lab, client, seed), console, stack)
        try:
            return evaluation.measure(site, seed, trials, pictures)
        except (HandeyeError, RpcError):
            stack.check()  # says which process died rather than what that did to a call
            raise
