"""`handeye collect`: has the coordinator of a running stack collect samples, and helps where it takes a person."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from rich.console import Console

from handeye.cli.progress import counted
from handeye.client import Client
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

Progress = Callable[[str, int], AbstractContextManager[Callable[[], None]]]
"""Shows a bar with a title and a total; what it gives is called for each step done."""


def collect_in(state_dir: Path | None, modules: Sequence[Module], seed: int) -> None:
    """Collects for `modules`, in this order, in a running stack (see `teaching.joined`)."""
    console = Console(stderr=True)
    with joined(state_dir) as (_robot, lab, client):
        for module in modules:
            collect(module, lab, client, seed, lambda title, total: counted(console, title, total))


def collect(module: Module, lab: LabClient, client: Client, seed: int, progress: Progress) -> None:
    """Collects for one module; `JobFailed` says why it could not. The world is made anew before."""
    experimenter = Experimenter(lab, client, seed)
    if module == "CSS":
        views = volume_views(np.random.default_rng(seed))
        with progress("CSS: showing grids", len(views)) as advance:
            experimenter.show_grid(views, advance)
    elif module == "SCS":
        experimenter.register_ball()
        with progress("SCS: fixating the ball", FIXATIONS) as advance:
            experimenter.show_ball(FIXATIONS, NEARLY_CENTRED, advance)
    else:
        lab.reset(seed)
        with progress(f"{module}: babbling", POSTURES[module]) as advance:
            client.collect_postures(
                [module],
                postures=POSTURES[module],
                seed=seed,
                on_event=lambda event: advance() if event.kind == "posture" else None,
            ).raise_for_failure()
