"""What people would pick instead, each in its best form for one query per call from Python.

All use one thread. scipy, pykdtree, scikit-learn and brute force take float64 and answer with distances; hnswlib and
faiss take float32 and answer with squared distances: their answers are left as they come. The leaf sizes are the
libraries' own: others were no faster (scipy 8, 16, 32, unbalanced, not compact; pykdtree 8, 16, 32; scikit-learn 16 and
40).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from benchmarks.learner import brute
from benchmarks.learner.data import Floats

Array = NDArray[Any]
Answer = Any
"""Ids and distances, nearest first: (k,) or (1, k) each for one query, (q, k) for q; or what `Rival.ids_of` reads."""


class Rival(ABC):
    """A near-neighbour search: build it, then ask `one` with elements of `singles`, `many` with a `batch`."""

    dtype: ClassVar[type[np.floating[Any]]] = np.float64
    as_row: ClassVar[bool] = False
    """Whether a single query is a (1, d) array; made so outside the timing."""
    built_once: ClassVar[bool] = False
    """Whether its construction is timed once, on its own, not in turns."""
    slow_to_build: ClassVar[bool] = False
    """Whether it is left out where there are very many points."""

    scans: ClassVar[bool] = False
    """Whether it looks at every point, so that all queries take the same time."""

    @abstractmethod
    def build(self, points: Floats) -> None:
        """Takes (n, d) points; replaces those taken before."""

    @abstractmethod
    def one(self, query: Array, k: int, /) -> Answer:
        """The k nearest to one query."""

    @abstractmethod
    def many(self, queries: Array, k: int, /) -> Answer:
        """The k nearest to each of (q, d) queries."""

    def ids_of(self, answer: Answer) -> Array:
        """(q, k) the neighbours that `many` has found."""
        ids: Array = answer[0]
        return ids

    def singles(self, queries: Floats) -> list[Array]:
        """Each query in the form that `one` takes fastest."""
        taken = self.batch(queries)
        return [np.ascontiguousarray(query[np.newaxis] if self.as_row else query) for query in taken]

    def batch(self, queries: Floats) -> Array:
        """The queries in the form that `many` takes fastest."""
        return np.ascontiguousarray(queries, self.dtype)


class Tuned(Rival):
    """An approximate search with a knob, `effort`: more of it finds more and takes longer."""

    @abstractmethod
    def set_effort(self, effort: int) -> None:
        """Turns the knob; at least k."""

    def tune(self, queries: Floats, truth: Array, recall: float) -> int:
        """Sets and returns the smallest effort that finds the share `recall` of the queries' true neighbours (q, k).

        Should none do, the number of points: all are looked at then.
        """
        asked, k = self.batch(queries), int(truth.shape[1])

        def enough(effort: int) -> bool:
            self.set_effort(effort)
            return recall_of(self.ids_of(self.many(asked, k)), truth) >= recall

        low, high = k - 1, k
        while not enough(high) and high < self.size:
            low, high = high, min(2 * high, self.size)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if enough(middle) else (middle, high)
        self.set_effort(high)
        return high

    @property
    @abstractmethod
    def size(self) -> int:
        """How many points it holds."""


class Graph(Tuned):
    """Neighbours of neighbours; the knob is ef."""

    dtype = np.float32
    built_once = True
    slow_to_build = True


class Brute(Rival):
    """All distances, in numba."""

    scans = True

    def build(self, points: Floats) -> None:
        self._points = np.ascontiguousarray(points)
        self._one, self._many = _compiled_once(points.shape[1])

    def one(self, query: Array, k: int, /) -> Answer:
        ids, distances = np.empty(k, np.int64), np.empty(k)
        self._one(self._points, query, ids, distances)
        return ids, distances

    def many(self, queries: Array, k: int, /) -> Answer:
        ids, distances = np.empty((len(queries), k), np.int64), np.empty((len(queries), k))
        self._many(self._points, queries, ids, distances)
        return ids, distances


class Scipy(Rival):
    """scipy.spatial.cKDTree."""

    def build(self, points: Floats) -> None:
        from scipy.spatial import cKDTree

        self._query = cKDTree(points).query

    def one(self, query: Array, k: int, /) -> Answer:
        distances, ids = self._query(query, k)
        return ids, distances

    many = one


class Pykdtree(Rival):
    """pykdtree.kdtree.KDTree."""

    as_row = True

    def build(self, points: Floats) -> None:
        from pykdtree.kdtree import KDTree

        self._query = KDTree(points).query

    def one(self, query: Array, k: int, /) -> Answer:
        distances, ids = self._query(query, k)
        return ids, distances

    many = one


class ScikitLearn(Rival):
    """sklearn.neighbors.KDTree, told that its input is finite: that saves it a sixth of a single query's time."""

    as_row = True

    def build(self, points: Floats) -> None:
        import sklearn
        from sklearn.neighbors import KDTree

        sklearn.set_config(assume_finite=True)
        self._query = KDTree(points).query

    def one(self, query: Array, k: int, /) -> Answer:
        distances, ids = self._query(query, k)
        return ids, distances

    many = one


class Hnswlib(Graph):
    """hnswlib, M = 16, ef_construction = 200."""

    def build(self, points: Floats) -> None:
        import hnswlib

        self._index = hnswlib.Index("l2", points.shape[1])
        self._index.init_index(len(points), M=16, ef_construction=200, random_seed=100)
        self._index.set_num_threads(1)
        self._index.add_items(points.astype(np.float32), num_threads=1)

    def set_effort(self, effort: int) -> None:
        self._index.set_ef(effort)

    @property
    def size(self) -> int:
        return int(self._index.element_count)

    def one(self, query: Array, k: int, /) -> Answer:
        return self._index.knn_query(query, k)

    many = one


class _Faiss(Rival):
    """What faiss's indices share. A single query skips the checks of `search`, which cost 1 µs."""

    dtype = np.float32
    as_row = True

    def __init__(self) -> None:
        import faiss

        faiss.omp_set_num_threads(1)
        self._faiss = faiss

    def _index_of(self, index: Any, points: Floats) -> None:
        index.add(points.astype(np.float32))
        self._index = index

    def one(self, query: Array, k: int, /) -> Answer:
        ids, distances = np.empty((1, k), np.int64), np.empty((1, k), np.float32)
        at = self._faiss.swig_ptr
        self._index.search_c(1, at(query), k, at(distances), at(ids))
        return ids, distances

    def many(self, queries: Array, k: int, /) -> Answer:
        distances, ids = self._index.search(queries, k)
        return ids, distances


class FaissFlat(_Faiss):
    """faiss.IndexFlatL2: brute force with single precision."""

    scans = True

    def build(self, points: Floats) -> None:
        self._index_of(self._faiss.IndexFlatL2(points.shape[1]), points)


class FaissGraph(_Faiss, Graph):
    """faiss.IndexHNSWFlat, M = 16, efConstruction = 200."""

    def build(self, points: Floats) -> None:
        index = self._faiss.IndexHNSWFlat(points.shape[1], 16)
        index.hnsw.efConstruction = 200
        self._index_of(index, points)

    def set_effort(self, effort: int) -> None:
        self._index.hnsw.efSearch = effort

    @property
    def size(self) -> int:
        return int(self._index.ntotal)


RIVALS: dict[str, Callable[[], Rival]] = {
    "brute force (numba)": Brute,
    "scipy cKDTree": Scipy,
    "pykdtree": Pykdtree,
    "scikit-learn KDTree": ScikitLearn,
    "faiss flat": FaissFlat,
    "hnswlib": Hnswlib,
    "faiss HNSW": FaissGraph,
}
"""Every rival by the name it has in the tables."""


def recall_of(found: Array, truth: Array) -> float:
    """Share of the true neighbours' ids (q, k) that are among those found (q, k)."""
    return float(np.mean([np.isin(true, near).mean() for near, true in zip(found, truth, strict=True)]))


_kernels: dict[int, tuple[Callable[..., Any], Callable[..., Any]]] = {}


def _compiled_once(d: int) -> tuple[Callable[..., Any], Callable[..., Any]]:
    if d not in _kernels:
        _kernels[d] = brute.compiled(d)
    return _kernels[d]
