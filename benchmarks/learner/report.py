"""The results as JSON, and as tables in Markdown and on the terminal."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table as Drawn

from benchmarks.learner.growth import fit
from benchmarks.learner.measure import RECALL, K, Result
from benchmarks.learner.pictures import draw
from benchmarks.learner.systems import BASE, BEAM, FASTEST_OF, GRAPH
from benchmarks.learner.targets import Findings, targets

LIBRARIES = ("numpy", "numba", "scipy", "pykdtree", "scikit-learn", "hnswlib", "faiss-cpu")

Cell = Callable[[Result], str]


class Table(NamedTuple):
    """What Markdown and the terminal show."""

    title: str
    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: int = 1
    """How many columns, from the left, are no numbers."""


CELLS: dict[str, tuple[str, Cell]] = {
    "One query per call": (
        f"µs per call from Python, median of the rounds (ratio to the fastest of {', '.join(FASTEST_OF)}). "
        "Answers are computed whole, but nothing is read out of them: see Reading an answer.",
        lambda result: f"{result.single.median:.1f} ({result.single.to_fastest:.2f})",
    ),
    "Many queries per call": (
        f"µs per query, median of the rounds (ratio to {BASE}).",
        lambda result: f"{result.batch.median:.2f} ({result.batch.to_base:.2f})",
    ),
    "Construction": (
        f"ms, median of the rounds (ratio to {BASE}). Graphs and models were built once; the beam's tree is the exact "
        "search's. Models also estimate gradients and calibrate support and expected errors.",
        lambda result: "" if result.system == BEAM else f"{result.build.median / 1e3:.3g} ({result.build.to_base:.2f})",
    ),
    "Memory": (
        "What the index keeps, and the peak while it is built, in times the samples' own bytes (n × d × 8).",
        lambda result: (
            ""
            if result.weight is None
            else " / ".join(f"{each / (8 * result.n * result.d):.1f}" for each in result.weight)
        ),
    ),
    "Recall": (
        f"Share of the true {K} nearest; graphs and beam were tuned to {RECALL} on other queries (in brackets: ef or "
        "width).",
        lambda result: f"{result.recall:.4f}" + ("" if result.effort is None else f" ({result.effort})"),
    ),
}


def write(found: Findings, directory: Path, seed: int) -> None:
    """Writes results.json, results.md, results.png and batches.png into `directory`."""
    directory.mkdir(parents=True, exist_ok=True)
    content = {
        "k": K,
        "seed": seed,
        "versions": _versions(),
        "targets": [line._asdict() | {"verdict": line.verdict} for line in targets(found)],
        "results": [result.as_json() for result in found.results],
        "growth": [step._asdict() for step in found.growth],
        "insertions": [each._asdict() for each in found.insertions],
        "two": [each._asdict() for each in found.two],
        "reading": found.reading and found.reading._asdict(),
        "cold": found.cold and found.cold._asdict(),
    }
    (directory / "results.json").write_text(json.dumps(content, indent=1) + "\n")
    draw(found.results, directory)
    pictures = [each for each in ("results.png", "batches.png") if (directory / each).exists()]
    (directory / "results.md").write_text(markdown(found, seed, pictures))


def show(found: Findings) -> None:
    """Prints the tables."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=200)
    for table in tables(found):
        drawn = Drawn(title=table.title, caption=table.caption, title_justify="left", caption_justify="left")
        for number, column in enumerate(table.header):
            drawn.add_column(column, justify="left" if number < table.words else "right", overflow="fold")
        for row in table.rows:
            drawn.add_row(*row)
        console.print(drawn)


def markdown(found: Findings, seed: int, pictures: Sequence[str] = ()) -> str:
    """Every table, and the pictures."""
    used = ", ".join(f"{library} {number}" for library, number in _versions().items())
    lines = [
        "# The learner's benchmark",
        "",
        f"Made by `make bench`; [what is measured and how](../../README.md). One thread, k = {K}, data of seed {seed}. "
        f"hnswlib and faiss work in single precision, all others in double. {used}.",
    ]
    for number, table in enumerate(tables(found)):
        lines += ["", f"## {table.title}", "", table.caption, "", *_rows(table)]
        if number == 0:
            for picture in pictures:
                lines += ["", f"![{_ALT[picture]}]({picture})"]
    return "\n".join(lines) + "\n"


_ALT = {
    "results.png": "Time of one query per call against the number of points",
    "batches.png": f"Time of batches in times that of {BASE}",
}


def tables(found: Findings) -> Iterator[Table]:
    """Those of which something was measured."""
    lines = targets(found)
    if lines:
        yield Table(
            "Targets",
            "The worst of all cases, which one that is, and in how many cases the target is met. Ratios are medians of "
            "the rounds' ratios.",
            ("what", "target", "measured", "", "worst case"),
            [(line.what, line.target, line.measured, line.verdict, line.worst) for line in lines],
            words=5,
        )
    for title, (caption, cell) in CELLS.items():
        if any(map(cell, found.results)):
            yield _by_system(title, caption, found.results, cell)
    yield from _others(found)


def _others(found: Findings) -> Iterator[Table]:
    beams = [each for each in found.results if each.system == BEAM]
    graphs = {(each.points, each.n): each for each in found.results if each.system == GRAPH}
    if beams and graphs:
        yield Table(
            f"Beam and {GRAPH}",
            f"Batches, both tuned to recall {RECALL} on other queries: µs per query, recall on these, width or ef.",
            ("points", "n", "beam", "recall", "width", GRAPH, "recall", "ef", "beam / graph"),
            [
                (
                    *_place(beam), *_at_recall(beam), *_at_recall(graphs[beam.points, beam.n]),
                    f"{beam.batch.to_graph:.2f}",
                )
                for beam in beams
                if (beam.points, beam.n) in graphs
            ],
        )  # fmt: skip
    if found.reading:
        r = found.reading
        yield Table(
            "Reading an answer",
            "µs for one query among 800 samples in 3-D. `answer` computes everything but the expected error; reading "
            "cuts it out as arrays.",
            ("asked", "and output read", "and gradient, support, ids, distances, weights", "and expected error"),
            [(f"{r.answer:.1f}", f"{r.output:.1f}", f"{r.everything:.1f}", f"{r.expected:.1f}")],
            words=0,
        )
    if found.insertions:
        yield Table(
            "Insertion",
            "µs for one sample per call; the very next query found each. Growth of arrays is included, and with models "
            "gradients and recalibrations.",
            ("points", "by", "n", "inserted", "median", "mean", "longest"),
            [
                (
                    e.points,
                    e.what,
                    _number(e.n),
                    _number(e.more),
                    f"{e.median:.0f}",
                    f"{e.mean:.0f}",
                    f"{e.longest:.0f}",
                )
                for e in found.insertions
            ],
            words=2,
        )
    if found.growth:
        yield _growth(found)
    if found.two:
        yield Table(
            "Two at once",
            "Throughput of batches by two threads, and by two processes with a tree each, in times that of one.",
            ("points", "what", "n", "threads", "processes"),
            [(e.points, e.what, _number(e.n), f"{e.threads:.2f}", f"{e.processes:.2f}") for e in found.two],
            words=2,
        )
    if found.cold:
        without = "" if found.cold.uncached is None else f"{found.cold.uncached:.1f}"
        yield Table(
            "A fresh process's first answer",
            "s of wall time from the interpreter's start to its end: import, 800 samples in 3-D learned, one answer.",
            ("numba's cache warm", "without cache"),
            [(f"{found.cold.cached:.2f}", without)],
            words=0,
        )


def _growth(found: Findings) -> Table:
    """The steps of each set, and below them the lines through them."""
    rows: list[tuple[str, ...]] = []
    for name in dict.fromkeys(step.points for step in found.growth):
        steps = [step for step in found.growth if step.points == name]
        costs = [[getattr(step, cost) for step in steps] for cost in ("looked", "beam", "exact", "base")]
        for step in steps:
            rows.append(
                (
                    name,
                    _number(step.n),
                    f"{step.looked:.0f}",
                    f"{step.beam:.2f}",
                    f"{step.exact:.2f}",
                    f"{step.base:.2f}",
                )
            )
        lines = [fit([step.n for step in steps], cost) for cost in costs]
        rows.append((name, "per doubling", *(f"{line.slope:.2g}" for line in lines)))
        rows.append((name, "R² of that line", *(f"{line.r2:.3f}" for line in lines)))
        rows.append((name, "best power of n", *(f"{line.exponent:.2f}" for line in lines)))
    return Table(
        "Growth",
        "What a query costs in a batch: nodes that a beam of width 5 compares it with, µs of that beam, of the exact "
        f"search, and of {BASE}; then, for the line over log₂ n, what a doubling adds and how straight it is.",
        ("points", "n", "nodes, beam", "beam", "exact", BASE),
        rows,
    )


def _by_system(title: str, caption: str, results: Sequence[Result], cell: Cell) -> Table:
    """One row for each set of points, one column for each system that has a cell."""
    systems = [
        system
        for system in dict.fromkeys(each.system for each in results)
        if any(cell(each) for each in results if each.system == system)
    ]
    rows: dict[tuple[str, str], dict[str, str]] = {}
    for each in results:
        rows.setdefault(_place(each), {})[each.system] = cell(each)
    shown = [(*place, *(cells.get(s, "") for s in systems)) for place, cells in rows.items() if any(cells.values())]
    return Table(title, caption, ("points", "n", *systems), shown)


def _place(result: Result) -> tuple[str, str]:
    return result.points, _number(result.n)


def _at_recall(result: Result) -> tuple[str, str, str]:
    return f"{result.batch.median:.2f}", f"{result.recall:.4f}", str(result.effort)


def _number(n: int) -> str:
    return f"{n:,}".replace(",", "\u202f")


def _rows(table: Table) -> list[str]:
    rule = "".join("---|" if number < table.words else "---:|" for number in range(len(table.header)))
    return [f"| {' | '.join(table.header)} |", f"|{rule}", *(f"| {' | '.join(row)} |" for row in table.rows)]


def _versions() -> dict[str, str]:
    return {"Python": platform.python_version()} | {library: _version(library) for library in LIBRARIES}


def _version(library: str) -> str:
    try:
        return version(library)
    except PackageNotFoundError:
        return "not installed"
