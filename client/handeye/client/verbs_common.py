"""What the client's commands share: where the coordinator is, tables, progress, signals."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime
from types import FrameType
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from handeye.client import Client
from handeye.client.connection import find
from handeye.client.models import JobEvent, OnEvent, Point

Url = Annotated[str, typer.Option(envvar="HANDEYE_URL", help="The coordinator; default: the one of `handeye up`.")]
Token = Annotated[str, typer.Option(envvar="HANDEYE_TOKEN", help="Its token; default: the one of `handeye up`.")]
Yes = Annotated[bool, typer.Option("--yes", help="Do not ask whether it is meant.")]

_WIDE = 200
"""Columns of a table that goes into a file or another program."""


def connect(url: str, token: str) -> Client:
    """The coordinator that is meant."""
    found = find(url, token)
    return Client(found.url, found.token)


def show(title: str, columns: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """A table on stdout; what is a number stands at the right. An empty one is a line that says so."""
    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE)
    filled = [list(row) for row in rows]
    for number, column in enumerate(columns):
        numeric = bool(filled) and all(isinstance(row[number], int | float) for row in filled)
        table.add_column(Text(column), justify="right" if numeric else "left")
    for row in filled:
        table.add_row(*(Text(_cell(value)) for value in row))
    console = Console(width=None if sys.stdout.isatty() else _WIDE)
    console.print(table if filled else Text(f"{title}: none\n"), end="")


def _cell(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, datetime):
        return f"{value.astimezone():%Y-%m-%d %H:%M:%S}"
    if isinstance(value, tuple):
        return " ".join(map(_cell, value))
    return str(value)


def spelled(values: Iterable[float], digits: int) -> str:
    """Numbers with so many digits after the point, for a cell."""
    return " ".join(f"{value:{digits + 3}.{digits}f}" for value in values)


def seen(object_at: Point, hand_at: Point) -> str:
    """Where object and hand were in the pictures, in two lines of a cell."""
    return f"object {spelled(object_at, 1)}\nhand   {spelled(hand_at, 1)}"


@contextmanager
def job_bar(title: str) -> Iterator[OnEvent]:
    """A bar on stderr that shows how far a job is; gives what is to be told the job's events."""
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as bar:
        work = bar.add_task(Text(title).markup, total=None)

        def on_event(event: JobEvent) -> None:
            share = event.data.get("progress")
            if isinstance(share, int | float):
                bar.update(work, completed=share, total=1.0)

        yield on_event


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
