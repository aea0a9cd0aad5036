"""The `handeye run` command."""

from __future__ import annotations

from typing import Annotated

import typer

from handeye.client.client import Client
from handeye.client.connection import find
from handeye.client.models import Job, JobEvent


def register(app: typer.Typer) -> None:
    """Adds the verb `run` to the `handeye` command."""

    @app.command()
    def run(
        task: Annotated[str, typer.Argument(help="The trained task.")],
        object_name: Annotated[str, typer.Option("--object", help="What to do it with.")],
        one_look: Annotated[
            bool, typer.Option("--one-look", help="Answer once per subtask, as the thesis does.")
        ] = False,
        timeout: Annotated[
            float, typer.Option(help="Give up and stop the arm after so many seconds.", min=0.1)
        ] = 300.0,
        url: Annotated[
            str, typer.Option(envvar="HANDEYE_URL", help="The coordinator; default: the one of `handeye up`.")
        ] = "",
        token: Annotated[
            str, typer.Option(envvar="HANDEYE_TOKEN", help="Its token; default: the one of `handeye up`.")
        ] = "",
    ) -> None:
        """Do a trained task; the exit code is 0 only when it succeeded. Ctrl-C cancels it and stops the arm."""
        found = find(url, token)
        with Client(found.url, found.token) as client:
            job = client.run_task(task, object_name, one_look=one_look, timeout=timeout, on_event=_show)
        typer.echo(_summary(job.raise_for_failure()))


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


def _summary(job: Job) -> str:
    looks = sum(len(subtask.looks) for subtask in job.result.subtasks)
    names = ", ".join(subtask.name for subtask in job.result.subtasks)
    return f"Task '{job.task}' with '{job.object}' succeeded: {names} ({looks} looks)."
