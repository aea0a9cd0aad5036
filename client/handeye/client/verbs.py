"""The client's commands: all of them are registered here, and `run`, `stop` and `reset` are here."""

from __future__ import annotations

from typing import Annotated

import typer

from handeye.client import verbs_admin, verbs_demonstration, verbs_job, verbs_learning, verbs_module, verbs_teaching
from handeye.client.models import JobEvent, RunJob
from handeye.client.verbs_common import Token, Url, connect, signals_unwind


def register(app: typer.Typer) -> None:
    """Adds the client's verbs to the `handeye` command."""
    for part in (verbs_module, verbs_learning, verbs_teaching, verbs_demonstration, verbs_job, verbs_admin):
        part.register(app)
    app.command()(run)
    app.command()(stop)
    app.command()(reset)


def run(
    task: Annotated[str, typer.Argument(help="The trained task.")],
    object_name: Annotated[str, typer.Option("--object", help="What to do it with.")],
    one_look: Annotated[bool, typer.Option("--one-look", help="Answer once per subtask, as the thesis does.")] = False,
    timeout: Annotated[float, typer.Option(help="Give up and stop the arm after so many seconds.", min=0.1)] = 300.0,
    url: Url = "",
    token: Token = "",
) -> None:
    """Do a trained task; the exit code is 0 only when it succeeded. Ctrl-C and TERM cancel it and stop the arm."""
    with connect(url, token) as client, signals_unwind():
        job = client.run_task(task, object_name, one_look=one_look, timeout=timeout, on_event=_show)
    typer.echo(_summary(job.raise_for_failure()))


def stop(
    reason: Annotated[str, typer.Option(help="Why; the robot's state and log tell it.")] = "a person asked for it",
    url: Url = "",
    token: Token = "",
) -> None:
    """Brake the arm and latch the software stop, until `handeye reset`. Not safety-rated."""
    with connect(url, token) as client:
        client.stop_robot(reason)
    typer.echo("The robot is stopped; `handeye reset` lets it move again.")


def reset(url: Url = "", token: Token = "") -> None:
    """Clear the software stop; the next move is slow."""
    with connect(url, token) as client:
        client.reset_robot()
    typer.echo("The robot may move again.")


def _show(event: JobEvent) -> None:
    """One line on stderr for each subtask's beginning and end, and for each look."""
    data = event.data
    if event.kind == "subtask":
        typer.echo(f"{data['name']}: {data['state']}", err=True)
    elif event.kind == "look":
        largest = max(abs(value) for value in data["delta"])
        typer.echo(
            f"  look {data['number']}: largest answer {largest:.4f} rad, support {data['support']:.2f}", err=True
        )


def _summary(job: RunJob) -> str:
    looks = sum(len(subtask.looks) for subtask in job.result.subtasks)
    names = ", ".join(subtask.name for subtask in job.result.subtasks)
    return (
        f"Task '{job.subject}' with '{job.object}' succeeded: {names} ({looks} looks; why each motion was made: "
        f"`handeye job show {job.id}`)."
    )
