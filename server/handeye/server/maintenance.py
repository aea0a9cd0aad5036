"""What `handeye verify` and `handeye repair` show: a table on a terminal, else a line for each finding."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from handeye.server.settings import ServerSettings, StoreSettings
from handeye.server.store.check import verify
from handeye.server.store.findings import Finding
from handeye.server.store.reading import Watch
from handeye.server.store.repair import repair

_SHOWN = 200  # findings in a table; a pipe gets all


def verify_store(database_url: str) -> bool:
    """Shows what is wrong in the store; whether it is well."""
    console = Console()
    with _progress() as watch:
        findings = verify(database_url or _configured(), watch)
    if not findings:
        console.print("The store is well.")
        return True
    _show(console, ("table", "row", "what is wrong"), map(_cells, findings), len(findings))
    counted = "One finding" if len(findings) == 1 else f"{len(findings)} findings"
    console.print(f"{counted}; `handeye repair` mends what can be mended.", highlight=False)
    return False


def repair_store(database_url: str) -> None:
    """Mends the store and shows what was done."""
    console = Console()
    with _progress() as watch:
        report = repair(database_url or _configured(), watch)
    if not report.done:
        console.print("The store is well; nothing was changed.")
        return
    cells = ((*_cells(each.finding), each.remedy) for each in report.done)
    _show(console, ("table", "row", "what was wrong", "what was done"), cells, len(report.done))
    if report.original is not None:
        console.print(f"The damaged file is kept as {escape(str(report.original))}.", highlight=False, soft_wrap=True)
    console.print("The store is well now. What was set aside is in its table `set_aside`.", highlight=False)


def _configured() -> str:
    return StoreSettings().url(ServerSettings().data_dir)


@contextmanager
def _progress() -> Iterator[Watch]:
    """A line on stderr that says which table is looked at; nothing where stderr is no terminal."""
    with Console(stderr=True).status("looking") as status:
        yield lambda table, rows: status.update(f"{table}: {rows} rows")


def _cells(finding: Finding) -> tuple[str, ...]:
    return finding.table or "the store", finding.key, finding.problem


def _show(console: Console, titles: tuple[str, ...], rows: Iterable[tuple[str, ...]], count: int) -> None:
    if not console.is_terminal:
        for cells in rows:
            typer.echo("\t".join(cells))
        return
    table = Table(*titles, box=None, pad_edge=False)
    for _, cells in zip(range(_SHOWN), rows, strict=False):
        table.add_row(*map(escape, cells))
    console.print(table)
    if count > _SHOWN:
        console.print(f"… and {count - _SHOWN} more; `handeye verify | cat` lists all.", highlight=False)
