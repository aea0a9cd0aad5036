"""Batch construction against the literal tree, node by node (Fig 3.18)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from handeye import rpt
from handeye.rpt.kernels import layout
from tests.learner import reference
from tests.learner.examples import adversarial
from tests.learner.forms import JIT_OFF, RADII, Floats, answer, brute_force, canonical, examples, grids


def check_same(points: Floats, radii: list[float], *, keep_covered: bool = True) -> None:
    tree = rpt.build(points, radii=radii, keep_covered=keep_covered)
    literal = reference.build(points, radii, keep_covered=keep_covered)
    assert canonical(tree) == literal.canonical()
    assert tree.samples == len(literal.filed(literal.root))


@given(points=st.integers(1, 3).flatmap(grids), radii=st.sampled_from(RADII), keep=st.booleans())
@examples(400)
def test_is_the_literal_tree_node_by_node(points: Floats, radii: list[float], keep: bool) -> None:
    check_same(points, radii, keep_covered=keep)


@given(seed=st.integers(0, 10**6), n=st.integers(1, 80), d=st.integers(1, 5), levels=st.integers(1, 6))
@examples(150)
def test_is_the_literal_tree_on_random_points(seed: int, n: int, d: int, levels: int) -> None:
    points = np.random.default_rng(seed).normal(size=(n, d))
    check_same(points, [3.0 * 0.6**level for level in range(levels)])
    check_same(points, rpt.derive_radii(points, fan_out=3).tolist())


@pytest.mark.parametrize("case", adversarial())
@pytest.mark.parametrize("radii", [*RADII, None], ids=str)
@pytest.mark.parametrize("keep", [True, False], ids=["kept", "dropped"])
def test_is_the_literal_tree_on_adversarial_inputs(case: str, radii: list[float] | None, keep: bool) -> None:
    points = adversarial()[case]
    check_same(points, rpt.derive_radii(points).tolist() if radii is None else radii, keep_covered=keep)


@pytest.mark.parametrize("n", [layout.PAGE_LANES, layout.PAGE_LANES + 1, layout.FLAT_LANES + 1, 1300])
def test_is_the_literal_tree_where_leaves_take_several_pages(n: int) -> None:
    points = np.random.default_rng(n).normal(size=(n, 2))
    for radii in ([100.0], [1.0], [1.5, 0.2]):
        check_same(points, radii)
    check_same(np.repeat(points[: n // 8], 8, axis=0), [1.5, 0.2])


def test_the_order_of_the_samples_shapes_the_tree() -> None:
    points = np.array([[0.0], [2.0], [4.0]])
    assert canonical(rpt.build(points, radii=[3.0])) != canonical(rpt.build(points[[1, 0, 2]], radii=[3.0]))


def test_covered_samples_are_kept_or_dropped() -> None:
    points = np.random.default_rng(1).normal(size=(300, 3))
    kept, dropped = (rpt.build(points, radii=[1.0, 0.5], keep_covered=keep) for keep in (True, False))
    assert np.array_equal(kept.nodes().sample, dropped.nodes().sample)
    assert sorted(sample for leaf in kept.nodes().members for sample in leaf) == list(range(300))
    assert all(leaf in ((), (sample,)) for sample, leaf in zip(*dropped.nodes()[::4], strict=True))
    assert kept.samples == 300
    assert dropped.samples == len(np.unique(dropped.nodes().sample)) - 1 < 300


def test_no_samples_to_begin_with() -> None:
    tree = rpt.build(np.zeros((0, 2)), radii=[1.0])
    assert canonical(tree) == reference.build(np.zeros((0, 2)), [1.0]).canonical()
    assert (tree.samples, len(tree.points)) == (0, 0)
    with pytest.raises(ValueError, match="the 0 samples in the tree"):
        tree.exact([0.0, 0.0], 1)


@pytest.mark.timeout(60)
def test_very_many_identical_points() -> None:
    # More would be one leaf and must neither recurse nor be compared pair by pair.
    n = 1200 if JIT_OFF else 100_000
    points = np.ones((n, 2))
    for radii in (None, [1.0, 0.0]):
        tree = rpt.build(points, radii=radii)
        assert len(tree.nodes().sample) == 2
        assert tree.exact([1.0, 3.0], 5).ids.tolist() == tree.beam([1.0, 3.0], 5).ids.tolist() == [0, 1, 2, 3, 4]
        assert tree.exact([1.0, 3.0], 5).distances.tolist() == [2.0] * 5
        assert tree.exact([1.0, 1.0], 1200).ids.tolist() == list(range(1200))


def test_the_tree_keeps_a_copy_of_its_inputs() -> None:
    points, radii = np.zeros((2, 1)), np.array([1.0])
    tree = rpt.build(points, radii=radii)
    points[0] = radii[0] = 9
    assert tree.points[0, 0] == 0
    assert tree.radii[0] == 1


def test_a_row_of_numbers_is_samples_of_one_component() -> None:
    assert rpt.build([1.0, 2.0, 3.0]).points.shape == (3, 1)


# --- bad input --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("inputs", "radii", "message"),
    [
        (np.zeros((0, 3)), None, "non-empty"),
        (np.zeros((3, 0)), None, "non-empty"),
        (np.zeros((0, 0)), [1.0], "non-empty"),
        (np.zeros((2, 2, 2)), None, "non-empty"),
        (3.0, None, "non-empty"),
        ([[0.0, math.nan]], None, r"finite.*number \[0, 1\] is nan"),
        ([[0.0, math.inf]], None, "finite"),
        ([[None]], None, "finite"),
        ([[1e200]], None, "magnitude"),
        ([[10**400]], None, "double precision"),
        ([["a"]], None, "could not convert"),
        ([[0.0], [1.0, 2.0]], None, "inhomogeneous"),
        ([[1j]], None, "real numbers"),
        (np.array([[1j]]), None, "real numbers"),
        (np.array([["2020-01-01"]], dtype="datetime64[D]"), None, "real numbers"),
        ([[0.0]], [], "radii"),
        ([[0.0]], 1.0, "radii"),
        ([[0.0]], [[1.0]], "radii"),
        ([[0.0]], [1.0, 1.0], "radii"),
        ([[0.0]], [1.0, -1.0], "radii"),
        ([[0.0]], [1.0, 2.0], "radii"),
        ([[0.0]], [math.nan], "radii"),
        ([[0.0]], [2.0, math.nan, 1.0], "radii"),
        ([[0.0]], [math.inf, math.inf], "radii"),
        ([[0.0]], [2j, 1j], "real numbers"),
    ],
)
def test_bad_input_is_an_error(inputs: Any, radii: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rpt.build(inputs, radii=radii)


anything = st.one_of(
    arrays.arrays(
        st.sampled_from(["f8", "f4", "f2", "i8", "u1", "?", "c16", "O", "U3"]),
        arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=3),
    ),
    st.recursive(
        st.one_of(st.none(), st.floats(), st.integers(), st.text(max_size=2)), lambda s: st.lists(s, max_size=3)
    ),
)


@given(inputs=anything)
@examples(300)
def test_any_input_is_taken_rightly_or_refused(inputs: Any) -> None:
    try:
        tree = rpt.build(inputs)
    except (ValueError, TypeError):
        return
    points = np.array(inputs, dtype=np.float64).reshape(len(inputs), -1)
    assert np.array_equal(tree.points, points)
    assert answer(tree.exact(points[0], len(points))) == brute_force(points, points[0], len(points))
