"""The library's tree beside the literal one, and what the tests of both share."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numba
import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import ArrayLike, NDArray

from handeye import rpt
from handeye.rpt.kernels import layout
from tests.learner import reference

Floats = NDArray[np.float64]
Answer = tuple[list[int], list[float]]

JIT_OFF = bool(numba.config.DISABLE_JIT)

RADII = [[3.0], [4.0, 2.0, 1.0], [8.0, 4.0, 2.0, 1.0, 0.5], [1.5, 0.0], [math.sqrt(2), 1.0]]


def examples(compiled: int) -> settings:
    """Settings of hypothesis; without the compiler everything takes some hundred times as long."""
    count = max(5, compiled // 4) if JIT_OFF else compiled
    return settings(deadline=None, max_examples=count, suppress_health_check=[HealthCheck.too_slow])


def grids(components: int, *, least: int = 1, most: int = 40) -> st.SearchStrategy[Floats]:
    """Vectors on a coarse grid: duplicates, collinear points and equal distances are the rule, not the exception."""
    component = st.integers(-6, 6).map(float)
    return st.integers(least, most).flatmap(
        lambda n: arrays.arrays(np.float64, (n, components), elements=component, fill=st.nothing())
    )


def canonical(tree: rpt.Tree) -> reference.Canonical:
    """`reference.Tree.canonical` of the library's tree."""
    nodes = tree.nodes()
    return reference.canonical_of(nodes.sample.tolist(), nodes.level.tolist(), nodes.parent.tolist(), nodes.members)


def brute_force(points: Floats, query: ArrayLike, k: int, among: Iterable[int] | None = None) -> Answer:
    """The k nearest of `among` (all if not given), equally near ones by number; bit for bit as eq 3.1 is written."""
    squares = np.zeros(len(points))
    for component, x in zip(points.T, np.asarray(query, dtype=np.float64), strict=True):
        squares = squares + (component - x) * (component - x)
    chosen = np.arange(len(points)) if among is None else np.array(sorted(among), dtype=np.int64)
    order = chosen[np.argsort(squares[chosen], kind="stable")][:k]
    return order.tolist(), np.sqrt(squares[order]).tolist()


def answer(found: rpt.Neighbours) -> Answer:
    """One query's neighbours in the form of `brute_force`."""
    return found.ids.tolist(), found.distances.tolist()


def scan_nothing(tree: rpt.Tree) -> rpt.Tree:
    """Makes the exact search of a small tree go through its nodes instead of looking at all samples."""
    tree.arenas.integers[layout.FLAT] = 0
    return tree


class Twins:
    """The library's tree and the literal one, to which the same happens."""

    def __init__(self, points: ArrayLike, radii: Sequence[float], *, keep_covered: bool = True) -> None:
        self.fast = scan_nothing(rpt.build(points, radii=radii, keep_covered=keep_covered))
        self.literal = reference.build(points, radii, keep_covered=keep_covered)

    def insert(self, vectors: ArrayLike) -> None:
        """One vector or several."""
        for vector in np.asarray(vectors, dtype=np.float64).reshape(-1, self.fast.points.shape[1]).tolist():
            assert self.fast.insert(vector).tolist() == [self.literal.insert(vector)]

    def remove(self, ids: Iterable[int]) -> None:
        """Samples that have not been removed."""
        numbers = list(ids)
        self.fast.remove(numbers)
        for number in numbers:
            self.literal.remove(number)

    def repair(self) -> None:
        """Both are built anew."""
        self.fast.repair()
        scan_nothing(self.fast)
        self.literal.rebuild()

    def living(self) -> list[int]:
        """The samples that have not been removed, whether a tree kept them or not."""
        return [sample for sample in range(len(self.literal.points)) if sample not in self.literal.removed]

    def same(self) -> None:
        """Node by node; and how many are invisible, and how many samples can be answered."""
        assert canonical(self.fast) == self.literal.canonical()
        figures = self.fast.statistics()
        assert figures.invisible == len(self.literal.invisible())
        assert figures.samples == self.fast.samples == len(self.literal.filed(self.literal.root))
        assert self.fast.points.tolist() == [list(point) for point in self.literal.points]

    def same_answers(self, query: Sequence[float], k: int, width: int) -> None:
        """Of all kinds; k and width are cut down to what is there."""
        k = min(k, self.fast.samples)
        if k:
            ids, distances = answer(self.fast.exact(query, k))
            assert list(zip(ids, distances, strict=True)) == self.literal.exact(query, k)
            found = self.literal.beam(query, k, max(k, width))
            missing = k - len(found)
            ids, distances = answer(self.fast.beam(query, k, max(k, width)))
            assert list(zip(ids, distances, strict=True)) == found + [(-1, math.inf)] * missing
            for level in range(1, len(self.literal.radii) + 2):
                assert int(self.fast.at_level(query, level)) == self.literal.at_level(query, level)
