"""How the cost of a query grows with the number of samples, in handeye's searches and in scipy's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.learner.data import GENERATED
from benchmarks.learner.rivals import Scipy
from benchmarks.learner.timing import Timed, in_turns
from handeye.rpt import build

K = 5
WIDTH = K
"""Of the beam: the same for all n."""
SIZES = tuple(2**power for power in range(10, 21, 2))
QUERIES = 300
ROUNDS = 7


class Step(NamedTuple):
    """Costs of one query among n samples; times from batches, so that no call from Python is in them."""

    points: str
    n: int
    looked: float
    """Nodes that a beam of width 5 compares a query with, on average."""
    beam: float
    """µs, that beam."""
    exact: float
    """µs"""
    base: float
    """µs, scipy's cKDTree."""


class Line(NamedTuple):
    """y = a + slope log2 n."""

    slope: float
    """For each doubling of n."""
    r2: float
    """Share of the variance of y that the line explains."""
    exponent: float
    """e of the power n^e that fits best, for comparison."""


def growth(name: str, seed: int, sizes: Sequence[int] = SIZES) -> Iterator[Step]:
    """The steps of one generated set."""
    for n in sizes:
        problem = GENERATED[name](n, seed)
        queries = problem.queries[:QUERIES]
        tree, scipy = build(problem.points), Scipy()
        scipy.build(problem.points)
        times = in_turns(
            {
                "beam": Timed(lambda asked, k, tree=tree: tree.beam(asked, k, WIDTH), [queries]),  # type: ignore[misc]
                "exact": Timed(tree.exact, [queries]),
                "base": Timed(scipy.many, [queries]),
            },
            K,
            rounds=ROUNDS,
            calls=1,
        )
        looked = float(tree.nodes_looked_at(queries, WIDTH).mean())
        yield Step(name, n, looked, **{each: float(np.median(t)) / len(queries) for each, t in times.items()})


def fit(n: Sequence[int], y: Sequence[float]) -> Line:
    """The line through y over log2 n."""
    x, values = np.log2(n), np.asarray(y, np.float64)
    slope, start = np.polyfit(x, values, 1)
    left = ((values - start - slope * x) ** 2).sum()
    variance = ((values - values.mean()) ** 2).sum()
    exponent = np.polyfit(x, np.log2(values), 1)[0]
    return Line(float(slope), float(1 - left / variance) if variance > 0 else 1.0, float(exponent))
