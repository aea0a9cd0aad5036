"""The verbs `handeye teach`, `handeye place` and `handeye demo`."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from handeye.cli.up import Clock


class Collected(StrEnum):
    """What can be collected for."""

    CSS = "CSS"
    SCS = "SCS"
    AJS = "AJS"
    CAS = "CAS"
    IJS = "IJS"


class What(StrEnum):
    """What can be evaluated."""

    CSS = "css"
    SCS = "scs"
    PURSUIT = "pursuit"
    REACH = "reach"
    GRASP = "grasp"
    CLUMSY = "clumsy"
    WIDE = "wide"
    RESILIENCE = "resilience"
    SUPPORT = "support"
    POUR = "pour"
    STACK = "stack"
    VISION = "vision"


class Shown(StrEnum):
    """What can be taught."""

    GRASP = "grasp"
    POUR = "pour"
    STACK = "stack"


def register(app: typer.Typer) -> None:
    """Adds the simulated laboratory's verbs to the `handeye` command."""

    @app.command("teach")
    def teach(
        demonstrations: Annotated[int, typer.Option(min=1, help="How many sequences to show.")] = 10,
        seed: Annotated[int, typer.Option(min=0, help="Seed of the places and of the small motions.")] = 1,
        lesson: Annotated[Shown, typer.Option(help="What to show.")] = Shown.GRASP,
        task: Annotated[str | None, typer.Option(help="Name of the task; else the lesson's.")] = None,
        object_name: Annotated[str, typer.Option("--object", help="Which cup of the catalogue.")] = "blue cup",
        state_dir: Annotated[Path | None, typer.Option(help="State directory of the `handeye up` to teach.")] = None,
        watch_parent: Annotated[bool, typer.Option("--watch-parent", help="End when stdin ends.")] = False,
    ) -> None:
        """Show a running `handeye up` a task with a cup, as a person with the teach pendant would, and train it."""
        # Here, not above: every `handeye` command imports this module, few need what teaching needs.
        with silence():
            from handeye.simulation.teaching import teach as run

        run(
            demonstrations=demonstrations,
            seed=seed,
            lesson=lesson.value,
            task=task or lesson.value,
            object_name=object_name,
            state_dir=state_dir,
            watch_parent=watch_parent,
        )

    @app.command("place")
    def place(
        object_name: Annotated[str, typer.Argument(metavar="OBJECT", help="What of the catalogue.")],
        at: Annotated[
            tuple[float, float],
            typer.Option(
                metavar="X Y", help="m; x away from the robot (taught: 0.45..0.75), y to its left (-0.15..0.15)."
            ),
        ] = (0.6, 0.0),
        beside: Annotated[
            tuple[str, float, float] | None, typer.Option(metavar="OBJECT X Y", help="Another one, and where.")
        ] = None,
        liquid: Annotated[int, typer.Option(min=0, help="Particles to fill in; 40 are a quarter of a cup.")] = 0,
        seed: Annotated[int, typer.Option(min=0, help="Seed of the world's noises.")] = 1,
        state_dir: Annotated[Path | None, typer.Option(help="State directory of the `handeye up`.")] = None,
    ) -> None:
        """Make the world of a running `handeye up` anew: arm parked and free to move, a cup on the table."""
        with silence():
            from handeye.simulation.teaching import place as run

        run(object_name=object_name, at=at, seed=seed, state_dir=state_dir, beside=beside, liquid=liquid)

    @app.command("collect")
    def collect(
        modules: Annotated[list[Collected], typer.Argument(metavar="MODULE...", help="CAS needs CSS and SCS before.")],
        seed: Annotated[int, typer.Option(min=0, help="Seed of places and motions.")] = 1,
        state_dir: Annotated[Path | None, typer.Option(help="State directory of the `handeye up`.")] = None,
    ) -> None:
        """Have a running `handeye up` collect samples by itself; what takes a person is done by the simulated one.

        Called again it goes on where it ended. To begin anew, delete the module before.
        """
        from handeye.cli.supervisor import signals_unwind

        with silence():
            from handeye.simulation.collecting import MODULES, collect_in
        with signals_unwind():
            collect_in(state_dir, [name for name in MODULES if name in modules], seed)

    @app.command("evaluate")
    def evaluate(
        what: Annotated[What, typer.Argument(help="Which figures.")],
        seed: Annotated[list[int] | None, typer.Option(min=0, help="Of all that is drawn; several are pooled.")] = None,
        trials: Annotated[int, typer.Option(min=1, help="Random trials for each seed.")] = 100,
        clock: Annotated[Clock, typer.Option(help="How world time passes; pursuit: realtime.")] = Clock.LOCKSTEP,
        report: Annotated[Path, typer.Option(help="Where the page and the numbers go.")] = Path("report"),
        add: Annotated[bool, typer.Option("--add", help="Pool with what the report has of other seeds.")] = False,
    ) -> None:
        """Measure the hand-eye system in a lab of its own, and print the figures beside targets and thesis."""
        from handeye.cli.supervisor import signals_unwind

        with silence():
            from handeye.simulation.evaluation import EVALUATIONS, site
            from handeye.simulation.evaluation.outcome import Earlier
        from rich.console import Console

        console = Console(stderr=True)
        seeds = seed or [1]
        evaluation = EVALUATIONS[what.value]
        name = evaluation.report(clock)
        earlier = Earlier.read(report, name, seeds) if add else Earlier()
        with signals_unwind():
            for outcome in site.run(evaluation, seeds, trials, clock, console, earlier):
                outcome.write(report)  # after each seed: one that fails takes nothing with it
        Console().print(outcome.table())
        console.print(f"report: {report / f'{name}.html'}, {name}.json  ({outcome.seconds:.0f} s)")

    @app.command("demo")
    def demo(
        trials: Annotated[int, typer.Option(min=1, help="Random trials.")] = 10,
        seed: Annotated[int, typer.Option(min=0, help="Seed of all places and noises.")] = 1,
        report: Annotated[Path, typer.Option(help="Where report.html and report.json go.")] = Path("report"),
    ) -> None:
        """Teach the simulated robot ten sequences, test it, and print the table beside the thesis's."""
        from handeye.cli.supervisor import signals_unwind

        with silence():
            from handeye.simulation.demo import run_demo
            from handeye.simulation.report import ENOUGH
        from rich.console import Console

        console = Console(stderr=True)
        with signals_unwind():
            found = run_demo(trials, seed, report, console)
        Console().print(found.table())
        console.print(f"report: {report / 'report.html'}, {report / 'report.json'}  ({found.seconds:.0f} s)")
        if not found.passed:
            console.print(f"[red]A subtask passed in fewer than {ENOUGH:.0%} of the trials.[/]")
            raise typer.Exit(1)


@contextmanager
def silence() -> Iterator[None]:
    """Inside, nothing reaches stderr, from C code neither: PyBullet announces itself there when it is imported."""
    kept = os.dup(2)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
