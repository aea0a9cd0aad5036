"""What was promised, and what was measured."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from benchmarks.learner.cold import Cold
from benchmarks.learner.growth import Step, fit
from benchmarks.learner.insertion import Insertion
from benchmarks.learner.measure import RECALL, Result
from benchmarks.learner.reading import Reading
from benchmarks.learner.systems import ANSWER, BASE, BEAM, EXACT, FASTEST_OF, GRAPH
from benchmarks.learner.threads import Two

STRAIGHT = 0.95
"""A cost grows like log n when a line over log n explains at least this share of its variance."""


@dataclass(slots=True)
class Findings:
    """All that was measured in one run; what was left out is empty."""

    results: list[Result] = field(default_factory=list)
    growth: list[Step] = field(default_factory=list)
    insertions: list[Insertion] = field(default_factory=list)
    two: list[Two] = field(default_factory=list)
    reading: Reading | None = None
    cold: Cold | None = None


class Target(NamedTuple):
    """One line of the table."""

    what: str
    target: str
    measured: str
    """In the worst case, and in how many cases the target is met."""
    met: bool
    worst: str
    """Which case that is."""
    aim: bool = False
    """Not promised, only hoped for."""

    @property
    def verdict(self) -> str:
        """In words."""
        return ("aim " if self.aim else "") + ("met" if self.met else "missed")


class _Case(NamedTuple):
    value: float
    shown: str
    where: str


def targets(found: Findings) -> list[Target]:
    """Each target of which something was measured."""
    return [*_single(found), *_batches(found), *_construction(found), *_growth(found), *_rest(found)]


def _single(found: Findings) -> Iterator[Target]:
    mine = [each for each in found.results if each.system == ANSWER and each.n <= 100_000]
    yield from _worst(
        "One query per call: answer with support, gradient, neighbours and weights, 10² to 10⁵ points",
        f"≤ 1.00 × the fastest of {', '.join(FASTEST_OF)}",
        [_Case(each.single.to_fastest, f"{each.single.to_fastest:.2f} ×", _where(each)) for each in mine],
        1.0,
    )
    if found.reading:
        shown = f"{found.reading.answer:.1f} µs (output read: {found.reading.output:.1f} µs)"
        yield from _worst(
            "The same among 800 samples in 3-D",
            "≤ 5 µs (thesis: 400 µs)",
            [_Case(found.reading.answer, shown, "3-D Gaussian, 800")],
            5.0,
        )


def _batches(found: Findings) -> Iterator[Target]:
    exact = [each for each in found.results if each.system == EXACT]
    cases = [_Case(each.batch.to_base, f"{each.batch.to_base:.2f} ×", _where(each)) for each in exact]
    yield from _worst("Batches, exact, up to 16-D", f"≤ 1.50 × {BASE}", cases, 1.5)
    yield from _worst("Batches, exact, up to 16-D", f"≤ 1.00 × {BASE}", cases, 1.0, aim=True)
    beams = [
        _Case(each.batch.to_graph, f"{each.batch.to_graph:.2f} ×", _where(each))
        for each in found.results
        if each.system == BEAM and each.batch.to_graph is not None
    ]
    yield from _worst(f"Batches, beam at recall {RECALL}", f"≤ 1.00 × {GRAPH} at that recall", beams, 1.0, aim=True)


def _construction(found: Findings) -> Iterator[Target]:
    exact = [each for each in found.results if each.system == EXACT]
    built = [_Case(each.build.to_base, f"{each.build.to_base:.2f} ×", _where(each)) for each in exact]
    yield from _worst("Construction", f"≤ 2.00 × {BASE}", built, 2.0)
    for what in dict.fromkeys(each.what for each in found.insertions):
        some = [each for each in found.insertions if each.what == what]
        for which in ("median", "mean"):
            cases = [_Case(getattr(each, which), f"{getattr(each, which):.0f} µs", _where(each)) for each in some]
            yield from _worst(
                f"One sample inserted by {what} and known to the next query, {which}", "< 100 µs", cases, 100.0
            )


def _growth(found: Findings) -> Iterator[Target]:
    costs: dict[str, tuple[str, Callable[[Step], float]]] = {
        "nodes that a beam of width 5 looks at": ("nodes", lambda step: step.looked),
        "time of that beam": ("µs", lambda step: step.beam),
        "time of the exact search": ("µs", lambda step: step.exact),
    }
    names = list(dict.fromkeys(step.points for step in found.growth))
    for what, (unit, cost) in costs.items():
        cases = []
        for name in names:
            line = fit(*_over_n(found.growth, name, cost))
            shown = f"R² = {line.r2:.2f} ({line.slope:.2g} {unit} per doubling; n^{line.exponent:.2f})"
            cases.append(_Case(1 - line.r2, shown, name))
        yield from _worst(f"Growth like log n: {what}", f"straight over log n: R² ≥ {STRAIGHT}", cases, 1 - STRAIGHT)


def _rest(found: Findings) -> Iterator[Target]:
    weighed = [each for each in found.results if each.system == EXACT and each.weight is not None]
    for what, limit, chosen in (
        ("Memory in 3-D", 4.0, [each for each in weighed if each.d < 6]),
        ("Memory from 6-D", 3.0, [each for each in weighed if each.d >= 6]),
    ):
        cases = [_Case(share := times_samples(each), f"{share:.2f} ×", _where(each)) for each in chosen]
        yield from _worst(what, f"≤ {limit:.0f} × the samples", cases, limit)
    two = [
        _Case(
            -each.threads,
            f"{each.threads:.2f} × (two processes: {each.processes:.2f} ×)",
            f"{each.what}, {_where(each)}",
        )
        for each in found.two
    ]
    yield from _worst("Throughput of two threads, batches", "≥ 1.70 × one thread", two, -1.7)
    if found.cold:
        without = "" if found.cold.uncached is None else f" (without numba's cache: {found.cold.uncached:.0f} s)"
        cases = [_Case(found.cold.cached, f"{found.cold.cached:.2f} s{without}", "3-D Gaussian, 800")]
        yield from _worst("A fresh process's first answer, numba's cache warm", "≤ 2 s", cases, 2.0)


def times_samples(result: Result) -> float:
    """What an index keeps, in times the samples' own bytes."""
    return 0.0 if result.weight is None else result.weight.kept / (8 * result.n * result.d)


def _worst(what: str, target: str, cases: Sequence[_Case], limit: float, *, aim: bool = False) -> Iterator[Target]:
    """The line about cases whose values must not exceed the limit (rounded as they are shown)."""
    if not cases:
        return
    met = sum(round(case.value, 2) <= limit + 1e-9 for case in cases)
    worst = max(cases)
    measured = worst.shown if len(cases) == 1 else f"{worst.shown}; {met} of {len(cases)} met"
    yield Target(what, target, measured, met == len(cases), worst.where, aim)


def _where(each: Result | Insertion | Two) -> str:
    return f"{each.points}, {each.n}"


def _over_n(steps: Sequence[Step], name: str, cost: Callable[[Step], float]) -> tuple[list[int], list[float]]:
    mine = [step for step in steps if step.points == name]
    return [step.n for step in mine], [cost(step) for step in mine]
