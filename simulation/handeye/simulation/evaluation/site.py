"""Where an evaluation takes place: a stack of its own, its coordinator, its laboratory, and a person who helps."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from rich.console import Console

from handeye.cli.progress import counted
from handeye.cli.up import Clock, Stack
from handeye.client import Client, HandeyeError
from handeye.rpc import Bus
from handeye.rpc.errors import RpcError
from handeye.simulation.evaluation.outcome import Outcome
from handeye.simulation.experimenter import Experimenter
from handeye.simulation.lab import LabClient
from handeye.simulation.teaching import lab_settings


@dataclass(frozen=True, slots=True)
class Site:
    """A running stack and all who work at it."""

    client: Client
    lab: LabClient
    experimenter: Experimenter
    console: Console

    def progress(self, title: str, total: int) -> AbstractContextManager[Callable[[], None]]:
        """A bar; what is given is called for each step done."""
        return counted(self.console, title, total)


class Evaluate(Protocol):
    """One evaluation: (site, seed, trials)."""

    def __call__(self, site: Site, seed: int, trials: int, /) -> Outcome:
        """Measures."""
        ...


def run(evaluate: Evaluate, seed: int, trials: int, clock: Clock, console: Console) -> Outcome:
    """Starts a stack in a state directory of its own, evaluates, and ends it."""
    started = time.monotonic()
    with ExitStack() as opened:
        state_dir = Path(opened.enter_context(tempfile.TemporaryDirectory(prefix="handeye-evaluate-")))
        stack = opened.enter_context(Stack(state_dir, clock=clock, console=console))
        client = opened.enter_context(Client(stack.url, stack.token))
        lab = LabClient(opened.enter_context(Bus.open(lab_settings(stack.lab), name="evaluation")))
        try:
            outcome = evaluate(Site(client, lab, Experimenter(lab, client, seed), console), seed, trials)
        except (HandeyeError, RpcError):
            stack.check()  # says which process died rather than what that did to a call
            raise
    return replace(outcome, seconds=time.monotonic() - started)
