"""One cell of the benchmark: every system on one set of points."""

from __future__ import annotations

import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass

import numpy as np

from benchmarks.learner.data import Floats, Problem
from benchmarks.learner.memory import Weight, weigh
from benchmarks.learner.rivals import Brute, Rival, Tuned, recall_of
from benchmarks.learner.systems import BASE, BEAM, FASTEST_OF, GRAPH, SYSTEMS
from benchmarks.learner.timing import Timed, Times, in_turns, ratio

K = 5
RECALL = 0.98
"""What graphs and beam are tuned to, on queries of their own."""
TUNED_ON = 500
"""Queries."""
ROUNDS = 40
BATCH_ROUNDS = 10
BATCHES = 4
"""Calls in a round, so many queries in each that the call itself is nothing beside them."""
BUILD_ROUNDS = 5
BUILD_ROUNDS_OF_MANY = 3
MANY = 1_000_000
"""Points."""
WARM_UP = 100
"""Points; a first build of so many loads the library."""
WEIGHED_FROM = 10_000_000
"""Bytes of points; smaller indices drown in the allocator's noise."""


@dataclass(frozen=True, slots=True)
class Duration:
    """Median and least of the rounds, µs for one query (or one build), and how many times as long as others."""

    median: float
    least: float
    to_base: float
    """Median of the rounds' ratios to `systems.BASE`."""
    to_fastest: float
    """The same to the fastest of `systems.FASTEST_OF`."""
    to_graph: float | None
    """The same to `systems.GRAPH`, where that was built."""


@dataclass(frozen=True, slots=True)
class Result:
    """What one system did on one set of points."""

    points: str
    n: int
    d: int
    system: str
    recall: float
    """Share of the true K nearest found, over the reported queries."""
    effort: int | None
    """The setting chosen: a graph's ef, a beam's width."""
    single: Duration
    batch: Duration
    build: Duration
    weight: Weight | None
    """Bytes."""

    def as_json(self) -> dict[str, object]:
        """Plain values."""
        return asdict(self) | {"weight": self.weight and self.weight._asdict()}


def measure(name: str, problem: Problem, *, slow: bool) -> list[Result]:
    """All systems on the problem; without `slow` those that are slow to build are left out."""
    n, d = problem.points.shape
    systems = {each: make() for each, make in SYSTEMS.items()}
    if not slow:
        systems = {each: system for each, system in systems.items() if not system.slow_to_build}
    build = _build(systems, problem.points)
    judge = Brute()
    judge.build(problem.points)
    effort = _tune(systems, problem.tuning[:TUNED_ON], judge)
    some = problem.queries[: int(np.clip(1e8 / n, 100, 1000))]
    truth, _ = judge.many(some, K)
    recall = {each: recall_of(it.ids_of(it.many(it.batch(some), K)), truth) for each, it in systems.items()}
    single = _one(systems, problem.queries, calls=int(np.clip(5e6 / n, 20, 100)))
    batch = _many(systems, problem.queries, scanned=int(np.clip(3e7 / n, 100, 1000)))
    # The beam's tree is the exact search's.
    weights = _weights([each for each in systems if each != BEAM], problem.points) if 8 * n * d >= WEIGHED_FROM else {}
    return [
        Result(
            name, n, d, each, recall[each], effort.get(each), single[each], batch[each], build[each], weights.get(each)
        )
        for each in systems
    ]


def _tune(systems: Mapping[str, Rival], queries: Floats, judge: Brute) -> dict[str, int]:
    """Sets every knob to the least effort that reaches `RECALL`; which that is."""
    truth, _ = judge.many(queries, K)
    tuned = {each: system for each, system in systems.items() if isinstance(system, Tuned)}
    return {each: system.tune(queries, truth, RECALL) for each, system in tuned.items()}


def _weights(systems: list[str], points: Floats) -> dict[str, Weight]:
    """Two at a time: processes of their own, and no clock runs."""
    with ThreadPoolExecutor(2) as pool:
        return dict(zip(systems, pool.map(lambda each: weigh(each, points), systems), strict=True))


def _one(systems: Mapping[str, Rival], queries: Floats, calls: int) -> dict[str, Duration]:
    """One query per call, `calls` of them before the next system has its turn."""
    asked = {each: Timed(system.one, system.singles(queries)) for each, system in systems.items()}
    return _durations(in_turns(asked, K, rounds=ROUNDS, calls=calls))


def _many(systems: Mapping[str, Rival], queries: Floats, scanned: int) -> dict[str, Duration]:
    """A quarter of the queries per call, so that a call that is not counted can go before the others.

    Systems that look at every point for every query are asked the first `scanned` of the queries only.
    """

    def quarters(system: Rival) -> list[Floats]:
        asked = queries[:scanned] if system.scans else queries
        size = max(1, len(asked) // BATCHES)
        return [system.batch(asked[size * i : size * (i + 1)]) for i in range(BATCHES)]

    parts = {each: quarters(system) for each, system in systems.items()}
    asked = {each: Timed(system.many, parts[each]) for each, system in systems.items()}
    times = in_turns(asked, K, rounds=BATCH_ROUNDS, calls=BATCHES)
    return _durations({each: spent / len(parts[each][0]) for each, spent in times.items()})


def _build(systems: Mapping[str, Rival], points: Floats) -> dict[str, Duration]:
    """Builds every system from the points; those that are built once after the others."""
    rounds = BUILD_ROUNDS if len(points) < MANY else BUILD_ROUNDS_OF_MANY

    def builder(system: Rival) -> Timed:
        return Timed(lambda taken, _k: system.build(taken), [points])

    in_turn = {each: builder(system) for each, system in systems.items() if not system.built_once}
    times = in_turns(in_turn, K, rounds=rounds, calls=1)
    for each, system in systems.items():
        if system.built_once:
            system.build(points[:WARM_UP])
            begin = time.perf_counter_ns()
            system.build(points)
            times[each] = np.full(rounds, (time.perf_counter_ns() - begin) / 1e3)
    return _durations(times)


def _durations(times: Mapping[str, Times]) -> dict[str, Duration]:
    fastest = times[min(FASTEST_OF, key=lambda each: float(np.median(times[each])))]
    graph = times.get(GRAPH)
    return {
        each: Duration(
            median=float(np.median(spent)),
            least=float(spent.min()),
            to_base=ratio(spent, times[BASE]),
            to_fastest=ratio(spent, fastest),
            to_graph=None if graph is None else ratio(spent, graph),
        )
        for each, spent in times.items()
    }
