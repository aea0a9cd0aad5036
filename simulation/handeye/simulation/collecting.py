"""`handeye collect`: has the coordinator of a running stack collect samples, and helps where it takes a person."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from rich.console import Console

from handeye.cli.progress import counted
from handeye.client import ApiError, Client
from handeye.simulation.experimenter import Experimenter, volume_views
from handeye.simulation.lab import LabClient
from handeye.simulation.teaching import joined

Module = Literal["CSS", "SCS", "AJS", "CAS", "IJS"]
MODULES: tuple[Module, ...] = get_args(Module)
"""In an order in which each has what it needs: CAS needs CSS and SCS."""

FIXATIONS = 45
"""As many samples as the thesis had for SCS (4.2.4)."""
NEARLY_CENTRED = 9
"""So many of them from the ends of fixations: there the map must be exact for saccades to converge."""
POSTURES = {"AJS": 300, "CAS": 150, "IJS": 150}

Progress = Callable[[str, int, int], AbstractContextManager[Callable[[], None]]]
"""Shows a bar with a title, a total and what of it was done before; what it gives is called for each step done."""


def collect_in(state_dir: Path | None, modules: Sequence[Module], seed: int) -> None:
    """Collects for `modules`, in this order, in a running stack (see `teaching.joined`)."""
    console = Console(stderr=True)
    with joined(state_dir) as (_robot, lab, client):
        for module in modules:
            before = _taught(client, module).samples
            rejected = collect(module, lab, client, seed, partial(counted, console))
            samples = _taught(client, module).samples
            told = ", ".join(f"{count} {reason}" for reason, count in rejected.items()) or "none"
            console.print(f"{module}: {samples - before} samples more, {samples} in all. Rejected: {told}.")


def collect(module: Module, lab: LabClient, client: Client, seed: int, progress: Progress) -> Mapping[str, int]:
    """Collects for one module what it has not yet; `JobFailed` says why it could not. The world is made anew before.

    Returns how much was rejected, by reason.
    """
    experimenter = Experimenter(lab, client, seed)
    done = _taught(client, module).demonstrations
    if module == "CSS":
        views = volume_views(np.random.default_rng(seed))
        with progress("CSS: showing grids", len(views), done) as advance:
            return experimenter.show_grid(views[done:], advance)
    if module == "SCS":
        experimenter.register_ball()
        with progress("SCS: fixating the ball", FIXATIONS, done) as advance:
            return experimenter.show_ball(FIXATIONS, NEARLY_CENTRED, advance, done)
    lab.reset(seed)
    with progress(f"{module}: babbling", POSTURES[module], done) as advance:
        job = client.collect_postures(
            [module],
            postures=POSTURES[module],
            seed=seed,
            on_event=lambda event: advance() if event.kind == "posture" else None,
        ).raise_for_failure()
    return {} if job.result is None else job.result.rejected


@dataclass(frozen=True, slots=True)
class _Taught:
    """How much a module has been taught."""

    samples: int = 0
    demonstrations: int = 0
    """Views, fixations or postures that its samples come from."""


def _taught(client: Client, module: Module) -> _Taught:
    try:
        info = client.module(module)
    except ApiError as error:
        if error.code != "not_found":
            raise
        return _Taught()
    return _Taught(info.samples, info.demonstrations)
