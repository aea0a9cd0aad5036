"""Exact search against brute force, beams against the literal one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from handeye import rpt
from handeye.rpt.kernels import lanes, layout
from tests.learner import reference
from tests.learner.examples import adversarial
from tests.learner.forms import JIT_OFF, RADII, Floats, Twins, answer, brute_force, examples, grids, scan_nothing

SIZES = [1, 2, 7, 8, 9, 32, 33, 64, 65, 511, 512, 513, 1024, 1025] + [3000] * (not JIT_OFF)


@st.composite
def problems(draw: st.DrawFn) -> tuple[Floats, Floats, int]:
    """Points and a query on a coarse grid (many ties) or of any size; k up to the number of samples."""
    d = draw(st.integers(1, 4))
    numbers = [
        st.integers(-4, 4).map(float),
        st.floats(-1e6, 1e6),
        st.floats(-1e150, 1e150),
        st.floats(-1e-160, 1e-160),
    ]
    components = draw(st.sampled_from(numbers))
    shape = (draw(st.integers(2, 60)), d)
    rows = draw(arrays.arrays(np.float64, shape, elements=components, fill=st.nothing()))
    return rows[1:], rows[0], draw(st.integers(1, len(rows) - 1))


@given(problem=problems(), fan_out=st.sampled_from([2, 5, 32]))
@examples(300)
def test_exact_is_brute_force(problem: tuple[Floats, Floats, int], fan_out: int) -> None:
    points, query, k = problem
    tree = rpt.build(points, radii=rpt.derive_radii(points, fan_out=fan_out))
    expected = brute_force(points, query, k)
    assert answer(tree.exact(query, k)) == expected
    assert answer(scan_nothing(tree).exact(query, k)) == expected


@pytest.mark.parametrize("n", SIZES)
@pytest.mark.parametrize("radii", [[100.0], [0.8, 0.2], None], ids=["one leaf", "many leaves", "derived"])
def test_exact_is_brute_force_on_either_side_of_every_threshold(n: int, radii: list[float] | None) -> None:
    rng = np.random.default_rng(n)
    for points in (rng.normal(size=(n, 2)), rng.integers(-5, 6, size=(n, 3)) / 4, np.ones((n, 1))):
        tree = rpt.build(points, radii=radii)
        queries = [points[-1], points.mean(axis=0) + 0.01, points[0] + 50.0, np.round(points[n // 2])]
        for k in sorted({1, min(8, n), min(65, n), n if n < 600 else 1}):
            for query in queries[: 2 if JIT_OFF else 4]:
                assert answer(tree.exact(query, k)) == brute_force(points, query, k)


@pytest.mark.parametrize("d", [1, 9, 40] if JIT_OFF else [1, 2, 7, 8, 9, 12, 40])
def test_exact_is_brute_force_in_any_dimension(d: int) -> None:
    rng = np.random.default_rng(d)
    points = rng.normal(size=(520, d))
    tree = rpt.build(points)
    for query in rng.normal(size=(5, d)) * 2:
        assert answer(tree.exact(query, 6)) == brute_force(points, query, 6)


def test_all_of_many_samples_can_be_asked_for() -> None:
    n = 600 if JIT_OFF else 3000
    points = np.random.default_rng(3).normal(size=(n, 2))
    for tree in (rpt.build(points), rpt.build(points, radii=[0.5, 0.1])):
        assert answer(tree.exact([0.0, 0.0], n)) == answer(tree.beam([0.0, 0.0], n)) == brute_force(points, [0, 0], n)


def test_equally_near_samples_come_by_their_numbers() -> None:
    points = np.array([[1.0, 0.0], [0.0, -1.0], [0.0, 1.0], [-1.0, 0.0]])
    for order in ([0, 1, 2, 3], [2, 0, 3, 1]):
        for radii in ([9.0], [1.2], [0.1]):
            tree = scan_nothing(rpt.build(points[order], radii=radii))
            assert tree.exact([0.0, 0.0], 3).ids.tolist() == tree.beam([0.0, 0.0], 3, 4).ids.tolist() == [0, 1, 2]


# --- beams ------------------------------------------------------------------------------------------------------------


@given(
    points=st.integers(1, 3).flatmap(lambda d: grids(d, least=2, most=50)),
    radii=st.sampled_from(RADII),
    k=st.integers(1, 12),
    width=st.integers(1, 20),
    keep=st.booleans(),
)
@examples(300)
def test_beams_are_the_literal_ones(points: Floats, radii: list[float], k: int, width: int, keep: bool) -> None:
    twins = Twins(points[1:], radii, keep_covered=keep)
    for query in (points[0].tolist(), (points[-1] + 0.5).tolist()):
        twins.same_answers(query, k, width)


@pytest.mark.parametrize("case", adversarial())
def test_beams_are_the_literal_ones_on_adversarial_inputs(case: str) -> None:
    points = adversarial()[case]
    for radii in RADII:
        twins = Twins(points, radii)
        for query in (points[0], points[-1] + 0.5, points.mean(axis=0)):
            for k, width in [(1, 1), (1, 3), (4, 4), (3, 12)]:
                twins.same_answers(query.tolist(), k, width)


def test_beams_are_the_literal_ones_in_larger_trees() -> None:
    rng = np.random.default_rng(4)
    twins = Twins(rng.normal(size=(1500, 3)), [1.5, 0.8, 0.4])
    for query in rng.normal(size=(10, 3)):
        for k, width in [(1, 1), (5, 5), (5, 40), (70, 90)]:
            twins.same_answers(query.tolist(), k, width)


def nodes_looked_at(tree: reference.Tree, query: Sequence[float], width: int) -> int:
    """As `reference.Tree.beam`, counting the nodes that it compares with the query."""
    beam, looked = [tree.root], 0
    while any(node.children for node in beam):
        looked += sum(len(node.children) for node in beam)
        candidates = [child for node in beam for child in (node.children or [node])]
        beam = sorted(
            candidates, key=lambda node: (reference.squared(tree.points[node.sample], tuple(query)), node.sample)
        )[:width]
    return looked


def test_the_nodes_looked_at_are_those_of_the_literal_beam() -> None:
    rng = np.random.default_rng(5)
    twins = Twins(rng.normal(size=(200, 2)), [1.0, 0.5, 0.2])
    queries = rng.normal(size=(10, 2))
    for width in (1, 3, 10, 10**9):
        expected = [nodes_looked_at(twins.literal, query, width) for query in queries.tolist()]
        assert twins.fast.nodes_looked_at(queries, width).tolist() == expected
        single = twins.fast.nodes_looked_at(queries[0], width)
        assert (single.shape, int(single)) == ((), expected[0])


def test_a_beam_as_wide_as_the_tree_is_exact() -> None:
    points = np.random.default_rng(3).normal(size=(300, 3))
    tree = rpt.build(points, radii=[1.0, 0.5])
    queries = np.random.default_rng(5).normal(size=(20, 3))
    for width in (300, 10**12):
        for found, expected in zip(tree.beam(queries, 5, width), tree.exact(queries, 5), strict=True):
            assert np.array_equal(found, expected)


def test_a_wider_beam_finds_more_of_the_nearest() -> None:
    tree = rpt.build(np.random.default_rng(3).normal(size=(300, 3)), radii=[1.5, 0.5])
    queries = np.random.default_rng(6).normal(size=(50, 3))
    exact = tree.exact(queries, 5).ids

    def recall(width: int) -> float:
        found = tree.beam(queries, 5, width).ids
        return float(np.mean([len(set(a) & set(b)) / 5 for a, b in zip(found.tolist(), exact.tolist(), strict=True)]))

    assert recall(5) < recall(10) < recall(40)
    assert recall(40) > 0.95


# --- shapes and bad input ---------------------------------------------------------------------------------------------


def test_many_queries_are_many_single_ones() -> None:
    tree = rpt.build(np.random.default_rng(3).normal(size=(600, 3)), radii=[1.0, 0.5])
    queries = np.random.default_rng(7).normal(size=(5, 3))
    for search in (tree.exact, tree.beam):
        together = search(queries, 4)
        assert together.ids.shape == together.distances.shape == (5, 4)
        for i, query in enumerate(queries):
            assert answer(search(query, 4)) == (together.ids[i].tolist(), together.distances[i].tolist())
    levels = tree.at_level(queries, 2)
    assert levels.tolist() == [int(tree.at_level(query, 2)) for query in queries]
    assert (levels.shape, tree.at_level(queries[0], 2).shape) == ((5,), ())
    none = tree.exact(np.zeros((0, 3)), 4)
    assert none.ids.shape == none.distances.shape == (0, 4)


@pytest.mark.parametrize("search", ["exact", "beam"])
@pytest.mark.parametrize("k", [0, -1, 4])
def test_k_out_of_range_names_the_number_of_samples(search: str, k: int) -> None:
    tree = rpt.build([[0.0], [1.0], [2.0]])
    with pytest.raises(ValueError, match=f"between 1 and the 3 samples in the tree, not {k}"):
        getattr(tree, search)([0.0], k)


def test_k_counts_only_kept_samples() -> None:
    tree = rpt.build([[0.0], [0.1], [5.0]], radii=[1.0], keep_covered=False)
    assert tree.exact([0.1], 2).ids.tolist() == [0, 2]
    with pytest.raises(ValueError, match="the 2 samples"):
        tree.exact([0.1], 3)


@pytest.mark.parametrize(
    ("query", "message"),
    [
        ([0.0], "2 components"),
        (0.0, "2 components"),
        ([], "2 components"),
        (np.zeros((1, 1, 2)), "2 components"),
        ([math.nan, 0.0], "finite"),
        ([[0.0, 0.0], [-math.inf, 0.0]], r"number \[1, 0\] is -inf"),
        ([0.0, 2e150], "magnitude"),
        (["a", "b"], "could not convert"),
        (np.array([0.0, 1j]), "real numbers"),
    ],
)
def test_bad_queries_are_errors(query: Any, message: str) -> None:
    tree = rpt.build([[0.0, 0.0]])
    for search in (tree.exact, tree.beam, tree.at_level, tree.nodes_looked_at):
        with pytest.raises(ValueError, match=message):
            search(query, 1)


def test_bad_numbers_are_errors() -> None:
    tree = rpt.build([[0.0, 0.0], [1.0, 1.0]])
    for width in (1, 0, -3):
        with pytest.raises(ValueError, match=f"width must be at least k = 2, not {width}"):
            tree.beam([0.0, 0.0], 2, width)
    for width in (0, -3):
        with pytest.raises(ValueError, match=f"width must be at least k = 1, not {width}"):
            tree.nodes_looked_at([0.0, 0.0], width)
    for level in (0, -1):
        with pytest.raises(ValueError, match=f"levels count from 1, not {level}"):
            tree.at_level([0.0, 0.0], level)
    half: Any = 1.5
    for search in (tree.exact, tree.beam, lambda query, width: tree.beam(query, 1, width), tree.nodes_looked_at):
        with pytest.raises(TypeError, match="integer"):
            search([0.0, 0.0], half)


anything = st.one_of(
    arrays.arrays(
        st.sampled_from(["f8", "f4", "i8", "?", "c16", "O", "U3"]),
        arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=2),
    ),
    st.lists(st.one_of(st.none(), st.floats(), st.integers(), st.text(max_size=2), st.lists(st.floats())), max_size=3),
)


@given(query=anything)
@examples(300)
def test_any_query_is_answered_rightly_or_refused(query: Any) -> None:
    points = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 1.0]])
    tree = rpt.build(points)
    try:
        found = tree.exact(query, 3)
    except (ValueError, TypeError):
        return
    rows = np.atleast_2d(np.array(query, dtype=np.float64))
    assert found.ids.shape == (*np.shape(query)[:-1], 3)
    for row, ids, distances in zip(rows, *map(np.atleast_2d, found), strict=True):
        assert (ids.tolist(), distances.tolist()) == brute_force(points, row, 3)


def test_sizes_named_here_are_those_of_the_layout() -> None:
    for threshold in (lanes.LANES, layout.PAGE_LANES, layout.FLAT_LANES, layout.PAGE_LANES * layout.GROUP_LANES):
        assert {threshold, threshold + 1} <= set(SIZES)
