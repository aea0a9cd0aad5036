"""Exact and beam search."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from handeye import rpt


def brute_force(points: NDArray[np.float64], query: NDArray[np.float64], k: int) -> tuple[list[int], list[float]]:
    distances = []
    for point in points.tolist():
        total = 0.0
        for x, y in zip(point, query.tolist(), strict=True):
            total += (x - y) * (x - y)
        distances.append(math.sqrt(total))
    order = sorted(range(len(points)), key=lambda i: (distances[i], i))[:k]
    return order, [distances[i] for i in order]


@st.composite
def problems(draw: st.DrawFn) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Points and a query on a coarse grid (many ties) or of any size; k up to the number of samples."""
    d = draw(st.integers(1, 4))
    components = draw(st.sampled_from([st.integers(-4, 4).map(float), st.floats(-1e6, 1e6)]))
    rows = draw(st.lists(st.lists(components, min_size=d, max_size=d), min_size=1, max_size=50))
    query = draw(st.lists(components, min_size=d, max_size=d))
    return np.array(rows), np.array(query), draw(st.integers(1, len(rows)))


@given(problem=problems())
@settings(deadline=None, max_examples=100)
def test_exact_is_brute_force(problem: tuple[NDArray[np.float64], NDArray[np.float64], int]) -> None:
    points, query, k = problem
    found = rpt.query_exact(rpt.build(points), query, k)
    assert (found.ids.tolist(), found.distances.tolist()) == brute_force(points, query, k)


@given(problem=problems(), extra=st.integers(0, 5), keep=st.booleans())
@settings(deadline=None, max_examples=100)
def test_beam_finds_k_real_samples(
    problem: tuple[NDArray[np.float64], NDArray[np.float64], int], extra: int, keep: bool
) -> None:
    points, query, k = problem
    tree = rpt.build(points, keep_covered=keep)
    k = min(k, len(tree.members))
    ids, distances = rpt.query_beam(tree, query, k, k + extra)
    assert ids.shape == (k,)
    assert len(set(ids.tolist())) == k
    assert set(ids.tolist()) <= set(tree.members.tolist())
    for i, distance in zip(ids, distances, strict=True):
        assert distance == pytest.approx(np.linalg.norm(points[i] - query), abs=1e-9)
    assert sorted(zip(distances.tolist(), ids.tolist(), strict=True)) == list(
        zip(distances.tolist(), ids.tolist(), strict=True)
    )


def random_tree(n: int = 300, d: int = 3) -> rpt.Tree:
    return rpt.build(np.random.default_rng(3).normal(size=(n, d)))


def test_exact_is_brute_force_in_larger_trees() -> None:
    rng = np.random.default_rng(4)
    tree = random_tree()
    for query in rng.normal(size=(20, 3)) * 2:
        found = rpt.query_exact(tree, query, 7)
        assert (found.ids.tolist(), found.distances.tolist()) == brute_force(tree.points, query, 7)


def test_exact_meets_every_sample_when_asked_for_all() -> None:
    tree = random_tree(50)
    assert sorted(rpt.query_exact(tree, np.zeros(3), 50).ids.tolist()) == list(range(50))


def test_every_sample_finds_itself_by_beam() -> None:
    tree = random_tree()
    found = rpt.query_beam(tree, tree.points, 1)
    assert np.array_equal(found.ids[:, 0], np.arange(300))
    assert np.all(found.distances == 0)


def test_a_beam_as_wide_as_the_tree_is_exact() -> None:
    tree = random_tree()
    queries = np.random.default_rng(5).normal(size=(20, 3))
    wide, exact = rpt.query_beam(tree, queries, 5, 300), rpt.query_exact(tree, queries, 5)
    assert np.array_equal(wide.ids, exact.ids)
    assert np.array_equal(wide.distances, exact.distances)


def test_a_wider_beam_finds_more_of_the_nearest() -> None:
    tree = random_tree()
    queries = np.random.default_rng(6).normal(size=(50, 3))
    exact = rpt.query_exact(tree, queries, 5).ids

    def recall(width: int) -> float:
        found = rpt.query_beam(tree, queries, 5, width).ids
        return float(np.mean([len(set(a) & set(b)) / 5 for a, b in zip(found.tolist(), exact.tolist(), strict=True)]))

    assert recall(5) < recall(20)
    assert recall(20) > 0.95


def test_many_queries_are_many_single_ones() -> None:
    tree = random_tree()
    queries = np.random.default_rng(7).normal(size=(5, 3))
    for search in (rpt.query_exact, rpt.query_beam):
        together = search(tree, queries, 4)
        assert together.ids.shape == together.distances.shape == (5, 4)
        for i, query in enumerate(queries):
            assert np.array_equal(together.ids[i], search(tree, query, 4).ids)


def test_equally_near_samples_come_by_their_numbers() -> None:
    points = np.array([[1.0, 0.0], [0.0, -1.0], [0.0, 1.0], [-1.0, 0.0]])
    for order in ([0, 1, 2, 3], [2, 0, 3, 1]):
        tree = rpt.build(points[order])
        assert rpt.query_exact(tree, [0.0, 0.0], 3).ids.tolist() == [0, 1, 2]


@pytest.mark.parametrize("search", [rpt.query_exact, rpt.query_beam])
@pytest.mark.parametrize("k", [0, -1, 4])
def test_k_out_of_range_names_the_number_of_samples(search: object, k: int) -> None:
    tree = rpt.build([[0.0], [1.0], [2.0]])
    with pytest.raises(ValueError, match=f"between 1 and the 3 samples in the tree, not {k}"):
        search(tree, [0.0], k)  # type: ignore[operator]


def test_k_counts_only_kept_samples() -> None:
    tree = rpt.build([[0.0], [0.1], [5.0]], radii=[1.0], keep_covered=False)
    assert rpt.query_exact(tree, [0.1], 2).ids.tolist() == [0, 2]
    with pytest.raises(ValueError, match="the 2 samples"):
        rpt.query_exact(tree, [0.1], 3)


def test_bad_queries_are_errors() -> None:
    tree = rpt.build([[0.0, 0.0]])
    with pytest.raises(ValueError, match="2 components"):
        rpt.query_exact(tree, [0.0], 1)
    with pytest.raises(ValueError, match="2 components"):
        rpt.query_exact(tree, np.zeros((1, 1, 2)), 1)
    with pytest.raises(ValueError, match="finite"):
        rpt.query_beam(tree, [math.nan, 0.0], 1)
    with pytest.raises(ValueError, match="width must be at least k = 1"):
        rpt.query_beam(tree, [0.0, 0.0], 1, 0)
