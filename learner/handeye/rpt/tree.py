"""The Recursive Partition Tree: construction in one go or sample by sample, and search (thesis 3.2, Appendices A, B).

A node at level l holds one sample vector and stands for that vector's Voronoi cell among its siblings, inside its
parent's cell. The root is virtual: it stands for the whole space and holds no vector. A node that splits appears again
as its own first child. Leaves hold the samples that fall into their cell.
"""

from __future__ import annotations

import threading
from operator import index
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handeye.rpt.checks import as_points, as_radii, as_rows
from handeye.rpt.kernels import insert, invisible, layout, search
from handeye.rpt.kernels.answer import LARGEST
from handeye.rpt.kernels.construct import construct
from handeye.rpt.kernels.lanes import LANES
from handeye.rpt.radii import radii_of
from handeye.rpt.structure import Nodes, Statistics, list_nodes, widest_cells

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Scalar = TypeVar("Scalar", bound=np.generic)


class Neighbours(NamedTuple):
    """Samples near a query, nearest first, equally near ones by ascending number.

    ids and distances have shape (k,) for one query and (q, k) for q queries. Where a beam met fewer than k samples, or
    others were removed during the search, the rest is -1 and infinite.
    """

    ids: Integers
    distances: Floats


class Arenas(NamedTuple):
    """A tree as kernels see it (`kernels.layout`)."""

    integers: Integers
    floats: Floats


class Tree:
    """A Recursive Partition Tree; `build` makes one.

    Several threads may search while one inserts: a search answers for the samples that had been inserted when it began
    (batches release Python's lock). Removal counts from the next query on. Searches never wait for anything. Beside a
    writer this needs a processor that keeps stores and loads in order, as x86-64 does.
    """

    def __init__(self, points: Floats, radii: Floats | None, keep_covered: bool) -> None:
        """Use `build`."""
        self.radii = radii_of(points) if radii is None else radii
        """(L,) T(1) > ... > T(L); T(0) is infinite."""
        self._derived = radii is None
        self.keep_covered = keep_covered
        self._writing = threading.Lock()
        self._points = points
        self._size = len(points)
        self._alive = np.ones(len(points), np.bool_)
        self._construct()

    @property
    def points(self) -> Floats:
        """(n, d) every vector ever given, in the order given; a sample's number is its row."""
        return self._points[: self._size]

    @property
    def storage(self) -> Floats:
        """`points` with the room behind them, as kernels take it; writers replace it when it is full."""
        return self._points

    @property
    def slots(self) -> Integers:
        """Where in the arena of integers the entry of each sample stands; -1 where a sample was not kept."""
        return self._slots

    @property
    def samples(self) -> int:
        """How many samples can be answered: not removed and, unless the tree keeps them, not covered."""
        return self._kept

    @property
    def alive(self) -> NDArray[np.bool_]:
        """(n,) which samples have not been removed."""
        return self._alive[: self._size]

    @property
    def arenas(self) -> Arenas:
        """What kernels search. Writers change it in place; take it and `samples` once for each search."""
        return self._arenas

    def exact(self, queries: ArrayLike, k: int) -> Neighbours:
        """The k nearest samples, by branch and bound on the boxes around the nodes' samples.

        Args:
            queries: (d,) one query or (q, d) several.
            k: how many neighbours, at most the number of samples.

        Raises:
            ValueError: k is out of range; queries are of the wrong shape or not finite.
        """
        rows, shape = self._as_queries(queries, k)
        arenas = self._arenas
        ids, squares = np.empty((len(rows), k), np.int64), np.empty((len(rows), k))
        search.exact_many(rows, arenas.integers, arenas.floats, arenas.integers[layout.SAMPLES], ids, squares)
        return _neighbours(ids, squares, shape)

    def beam(self, queries: ArrayLike, k: int, width: int | None = None) -> Neighbours:
        """The k near samples that a beam search meets (3.2.2).

        On every level the `width` nearest nodes are kept, and only their children looked at on the next; leaves once
        reached stay among them. Not always the true nearest neighbours (Fig 3.36); `exact` finds those.

        Args:
            queries: (d,) one query or (q, d) several.
            k: how many neighbours, at most the number of samples.
            width: of the beam, at least k; k when not given.

        Raises:
            ValueError: k or width is out of range; queries are of the wrong shape or not finite.
        """
        rows, shape = self._as_queries(queries, k)
        beam_width = k if width is None else self._as_width(width, k)
        arenas = self._arenas
        ids, squares = np.empty((len(rows), k), np.int64), np.empty((len(rows), k))
        limit = arenas.integers[layout.SAMPLES]
        search.beam_many(rows, arenas.integers, arenas.floats, limit, beam_width, ids, squares)
        return _neighbours(ids, squares, shape)

    def at_level(self, queries: ArrayLike, level: int) -> Integers:
        """For each query the sample whose node stands for it at a level, or at the leaf where its branch ends (eq A.3).

        Returns:
            An array () for one query (d,), or (q,) for (q, d).

        Raises:
            ValueError: the level is below 1; queries do not fit.
        """
        rows, _ = self._as_queries(queries, 1)
        if level < 1:
            raise ValueError(f"levels count from 1, not {level}")
        arenas = self._arenas
        limit = int(arenas.integers[layout.SAMPLES])
        numbers = search.vectors_at_level(rows, arenas.integers, arenas.floats, limit, level)
        return np.asarray(numbers[0] if np.ndim(queries) == 1 else numbers)

    def nodes_looked_at(self, queries: ArrayLike, width: int) -> Integers:
        """How many nodes a beam of this width compares each query with (Fig 4.7); shaped as for `at_level`.

        Raises:
            ValueError: the width is below 1; queries do not fit.
        """
        rows, _ = self._as_queries(queries, 1)
        width = self._as_width(width, 1)
        arenas = self._arenas
        limit = int(arenas.integers[layout.SAMPLES])
        ids, squares = np.empty((len(rows), 1), np.int64), np.empty((len(rows), 1))
        looked = search.beam_many(rows, arenas.integers, arenas.floats, limit, width, ids, squares)
        return np.asarray(looked[0] if np.ndim(queries) == 1 else looked)

    def reserve(self, more: int) -> None:
        """Makes room for so many more samples, so that `storage` stays in place while they come."""
        with self._writing:
            self._make_room(more)

    def insert(self, inputs: ArrayLike) -> Integers:
        """Adds samples one after the other (Method I, Appendix A); the next query sees them.

        Radii that were derived fit the samples that were there then. Once as many have been inserted as the tree was
        last constructed from, they are derived anew from all that are left and the tree is repaired with them. That
        insertion takes as long as `build`, all together about twice as long; queries go on meanwhile. Radii that were
        given never change.

        Args:
            inputs: (d,) one vector or (n, d) several.

        Returns:
            (n,) the numbers of the new samples.

        Raises:
            ValueError: inputs do not fit or are not finite; nothing was added then.
        """
        rows = as_rows(inputs, self._points.shape[1], "inputs")
        with self._writing:
            first = self._size
            self._make_room(len(rows))
            self._points[first : first + len(rows)] = rows
            self._alive[first : first + len(rows)] = True
            for number in range(first, first + len(rows)):
                self._insert(number)
                if self._derived and self._size - self._constructed[0] > self._constructed[1]:
                    self.radii = radii_of(self.points[self.alive])
                    self._construct()
        return np.arange(first, first + len(rows))

    def remove(self, ids: ArrayLike) -> None:
        """Takes samples out; no later query finds them. A node that holds such a vector stays as a signpost.

        Raises:
            ValueError: a number is unknown, given twice, or was removed before; nothing was removed then.
            TypeError: what is given are no whole numbers.
        """
        given = np.ravel(np.asarray(ids))
        if given.dtype.kind not in "iu" and given.size:
            raise TypeError(f"samples are removed by their numbers, not by an array of {given.dtype}")
        numbers = given.astype(np.int64)
        with self._writing:
            known = (numbers >= 0) & (numbers < self._size)
            if not known.all() or len(np.unique(numbers)) < len(numbers) or not self._alive[numbers].all():
                raise ValueError(
                    f"samples can be removed once and must be among 0 to {self._size - 1}; got {numbers.tolist()[:10]}"
                )
            self._alive[numbers] = False
            for number in numbers[self._slots[numbers] >= 0].tolist():
                self._kept -= 1
                insert.remove(self._arenas.integers, number, self._slots)

    def repair(self) -> None:
        """Builds the tree anew, with the radii it has, from the samples that are left, in the order they came.

        Afterwards no node is invisible, every sample lies in the leaf that its own descent reaches, and removed samples
        are no signposts any more. Queries go on meanwhile. Takes about as long as `build`.
        """
        with self._writing:
            self._construct()

    def nodes(self) -> Nodes:
        """The tree's nodes, for tests and drawings."""
        with self._writing:
            return list_nodes(self._arenas.integers)

    def statistics(self) -> Statistics:
        """Figures about the tree; unlike searches, it waits for writers."""
        with self._writing:
            return self._measure()

    def _measure(self) -> Statistics:
        arenas = self._arenas
        nodes = list_nodes(arenas.integers)
        inner = nodes.child_count[nodes.child_count > 0]
        diameters = widest_cells(arenas.integers, arenas.floats, self._points.shape[1])
        living = self.points[self.alive]
        extent = living.max(axis=0) - living.min(axis=0) if len(living) else np.zeros(1)
        cells = [float(np.linalg.norm(extent)), *diameters]
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            ratios = 2 * np.array(cells[: len(self.radii)]) / self.radii[: len(cells)]
            kappa = np.nan_to_num(ratios ** self._points.shape[1], nan=0.0, posinf=np.inf)
        used = int(arenas.integers[layout.INTEGERS_END]) + int(arenas.integers[layout.FLOATS_END])
        return Statistics(
            levels=int(nodes.level.max()),
            nodes=len(nodes.sample) - 1,
            leaves=int((nodes.child_count[1:] == 0).sum()),
            samples=self._kept,
            widest=int(nodes.child_count.max()),
            fan_out=float(inner.mean()) if inner.size else 0.0,
            kappa=tuple(kappa.tolist()),
            invisible=int(invisible.count_invisible(arenas.integers, arenas.floats, self._points)),
            bytes=8 * (used + self._size * (self._points.shape[1] + 1)) + self._size,
        )

    def _construct(self) -> None:
        order = np.flatnonzero(self._alive[: self._size])
        slots = np.full(len(self._points), -1)
        integers, floats = construct(self._points[: self._size], order, self.radii, self.keep_covered, slots)
        self._slots = slots
        self._kept = int((slots >= 0).sum())
        self._constructed = self._size, len(order)
        self._stores = np.empty((insert.MOST_STORES, 2), np.int64)
        self._scratch = np.empty(LANES)
        self._arenas = Arenas(integers, floats)

    def _insert(self, number: int) -> None:
        outcome, count = self._prepare(number)
        while outcome == insert.NO_ROOM:
            integers, floats = self._arenas
            self._arenas = Arenas(larger(integers, 2 * len(integers)), larger(floats, 2 * len(floats)))
            outcome, count = self._prepare(number)
        self._size = number + 1
        insert.publish(self._arenas.integers, self._stores, count)
        # Last, so that no search asks for more samples than it finds.
        self._kept += outcome == insert.PREPARED

    def _prepare(self, number: int) -> tuple[int, int]:
        integers, floats = self._arenas
        outcome, count = insert.prepare(
            integers, floats, self._points, number, self.radii, self.keep_covered,
            self._slots, self._stores, self._scratch,
        )  # fmt: skip
        return int(outcome), int(count)

    def _make_room(self, more: int) -> None:
        needed = self._size + more
        if needed > len(self._points):
            size = max(needed, 2 * len(self._points), 64)
            self._points = larger(self._points, size)
            self._alive = larger(self._alive, size)
            slots = np.full(size, -1)
            slots[: len(self._slots)] = self._slots
            self._slots = slots

    def _as_queries(self, queries: ArrayLike, k: int) -> tuple[Floats, tuple[int, ...]]:
        """The queries as rows, and the shape of the answer."""
        if not 1 <= k <= self._kept:
            raise ValueError(f"k must be between 1 and the {self._kept} samples in the tree, not {k}")
        components = self._points.shape[1]
        if type(queries) is np.ndarray and queries.shape == (components,) and queries.dtype == np.float64:
            # One query after the other is the usual case: the checks of `as_rows`, without its copies.
            row = np.ascontiguousarray(queries)
            if search.all_within(row, LARGEST):
                return row.reshape(1, components), (k,)
        rows = as_rows(queries, components, "queries")
        return rows, (k,) if np.ndim(queries) == 1 else (len(rows), k)

    def _as_width(self, width: int, least: int) -> int:
        """A beam's width, and not more than there can be nodes in it."""
        if width < least:
            raise ValueError(f"the beam's width must be at least k = {least}, not {width}")
        return min(index(width), max(self._size, least))


def build(inputs: ArrayLike, *, radii: ArrayLike | None = None, keep_covered: bool = True) -> Tree:
    """Builds the tree from all samples at once, level by level, by the rules of Fig 3.18.

    Within level l the samples come in the order given; sample Q descends to leaf X. X above level l - 1: skip. X at
    level l - 1 and D(Q, X) > T(l): X and Q become children of X. X at level l and D(Q, X) > T(l): Q becomes its
    sibling. Otherwise Q is covered by X on this level. The first sample becomes the first node of level 1. Equal
    distances are decided for the smaller sample number.

    Args:
        inputs: (n, d) sample vectors; a (n,) array is taken as n samples with one component. With radii given there
            may be none: (0, d).
        radii: T(1) > ... > T(L) >= 0; derived from the data (`derive_radii`) when not given, and again as the tree
            grows (`Tree.insert`). They are the spacing S(l) of Appendix A for samples inserted later.
        keep_covered: samples that never became a node are kept in the leaf in whose cell they lie. False drops them,
            as the thesis does.

    Raises:
        ValueError: inputs are empty, not finite, of the wrong shape or too large; radii are not a decreasing sequence.
    """
    points = as_points(inputs, empty=radii is not None)
    return Tree(points, None if radii is None else as_radii(radii), keep_covered)


def _neighbours(ids: Integers, squares: Floats, shape: tuple[int, ...]) -> Neighbours:
    np.sqrt(squares, squares)
    return Neighbours(ids, squares) if len(shape) == 2 else Neighbours(ids[0], squares[0])


def larger(array: NDArray[Scalar], size: int) -> NDArray[Scalar]:
    """A copy with room for `size` rows."""
    roomy = np.empty((size, *array.shape[1:]), array.dtype)
    roomy[: len(array)] = array
    return roomy
