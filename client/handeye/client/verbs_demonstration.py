"""`handeye demonstration …`: what was shown, how it went, and forgetting it."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from handeye.client.models import Observation
from handeye.client.verbs_common import Token, Url, Yes, connect, seen, show, spelled

Label = Literal["success", "failure", "none"]

Id = Annotated[str, typer.Argument(metavar="DEMONSTRATION", help="Id of the demonstration.")]


def register(app: typer.Typer) -> None:
    """Adds the verb `demonstration`."""
    group = typer.Typer(no_args_is_help=True, help="Demonstrations: what was shown, and whether to learn from it.")
    group.command("list")(list_demonstrations)
    group.command("show")(show_demonstration)
    group.command("label")(label)
    group.command("delete")(delete)
    app.add_typer(group, name="demonstration")


def list_demonstrations(url: Url = "", token: Token = "") -> None:
    """All demonstrations, in the order they were begun."""
    with connect(url, token) as client:
        found = client.demonstrations()
    show(
        "Demonstrations",
        ("id", "task", "with", "state", "label", "subtasks", "observations", "created"),
        [(d.id, d.task, d.object, d.state, d.outcome, len(d.subtasks), d.observations, d.created) for d in found],
    )


def show_demonstration(demonstration: Id, url: Url = "", token: Token = "") -> None:
    """What was shown in a demonstration: its subtasks, and every observation with what was seen and the joints."""
    with connect(url, token) as client:
        shown, observations = client.demonstration(demonstration), client.observations(demonstration)
    labelled = f", {shown.outcome}" if shown.outcome else ""
    typer.echo(f"Demonstration '{shown.id}' of task '{shown.task}' with '{shown.object}': {shown.state}{labelled}")
    show("Subtasks", ("name", "then"), [(subtask.name, subtask.action) for subtask in shown.subtasks])
    show(
        "Observations",
        ("number", "subtask", "marked", "at s", "seen (row, column, disparity)", "joints (rad)"),
        [_row(each) for each in observations],
    )


def label(
    demonstration: Id,
    outcome: Annotated[Label, typer.Argument(help="How it went; nothing is learned from a failure.")],
    url: Url = "",
    token: Token = "",
) -> None:
    """Say how a demonstration went, or by `none` take back what was said."""
    with connect(url, token) as client:
        shown = client.label_demonstration(demonstration, None if outcome == "none" else outcome)
    labelled = f"is labelled a {shown.outcome}" if shown.outcome else "has no label"
    typer.echo(f"Demonstration '{shown.id}' {labelled}; the next `handeye train {shown.task}` goes by it.")


def delete(demonstration: Id, yes: Yes = False, url: Url = "", token: Token = "") -> None:
    """Delete a demonstration, and its samples from every module; the next query is answered without them."""
    if not yes:
        typer.confirm(f"Delete demonstration '{demonstration}', and its samples from every module?", abort=True)
    with connect(url, token) as client:
        client.delete_demonstration(demonstration)
    typer.echo(f"Demonstration '{demonstration}' is deleted, and its samples are out of every module.")


def _row(observation: Observation) -> tuple[object, ...]:
    looked = observation.object is not None and observation.hand is not None
    marks = [
        name for name, given in (("key", observation.key), ("goal", observation.goal), ("way", not looked)) if given
    ]
    return (
        observation.number,
        observation.subtask,
        ", ".join(marks) or None,
        round(observation.world_time, 2),
        seen(observation.object, observation.hand) if observation.object and observation.hand else None,
        spelled(observation.joints, 4),
    )
