"""The `handeye run`, `handeye stop` and `handeye reset` commands."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Annotated

import typer

from handeye.client.client import Client
from handeye.client.connection import find
from handeye.client.models import Job, JobEvent

Url = Annotated[str, typer.Option(envvar="HANDEYE_URL", help="The coordinator; default: the one of `handeye up`.")]
Token = Annotated[str, typer.Option(envvar="HANDEYE_TOKEN", help="Its token; default: the one of `handeye up`.")]


def register(app: typer.Typer) -> None:
    """Adds the verbs `run`, `stop` and `reset` to the `handeye` command."""
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
    found = find(url, token)
    with Client(found.url, found.token) as client, signals_unwind():
        job = client.run_task(task, object_name, one_look=one_look, timeout=timeout, on_event=_show)
    typer.echo(_summary(job.raise_for_failure()))


def stop(
    reason: Annotated[str, typer.Option(help="Why; the robot's state and log tell it.")] = "a person asked for it",
    url: Url = "",
    token: Token = "",
) -> None:
    """Brake the arm and latch the software stop, until `handeye reset`. Not safety-rated."""
    found = find(url, token)
    with Client(found.url, found.token) as client:
        client.stop_robot(reason)
    typer.echo("The robot is stopped; `handeye reset` lets it move again.")


def reset(url: Url = "", token: Token = "") -> None:
    """Clear the software stop; the next move is slow."""
    found = find(url, token)
    with Client(found.url, found.token) as client:
        client.reset_robot()
    typer.echo("The robot may move again.")


@contextmanager
def signals_unwind() -> Iterator[None]:
    """Inside, TERM and HUP end the process like Ctrl-C, by an exception: what is open is closed, a job is cancelled.

    For the main thread. The exit code is 128 + signal, as shells have it.
    """

    def unwind(signum: int, _frame: FrameType | None) -> None:
        raise SystemExit(128 + signum)

    # What is ignored from the start stays ignored: `nohup` means it so.
    heeded = [number for number in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, unwind) for number in heeded}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


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
