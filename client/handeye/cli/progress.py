"""How long work shows its progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn


@contextmanager
def progress(console: Console) -> Iterator[Progress]:
    """A display of tasks with bar, count and time on `console`."""
    columns = (
        SpinnerColumn(finished_text="[green]✓[/]"),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console) as bar:
        yield bar


@contextmanager
def counted(console: Console, title: str, total: int, done: int = 0) -> Iterator[Callable[[], None]]:
    """One bar on `console`; what is given is called for each of `total` steps done, some of them `done` before."""
    with progress(console) as bar:
        task = bar.add_task(title, total=total, completed=min(done, total))
        yield lambda: bar.advance(task)
