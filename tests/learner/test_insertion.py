"""Incremental construction, Method I (Appendix A), after every sample against the literal tree; adoption and repair."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handeye import rpt
from handeye.rpt.kernels import layout
from tests.learner import reference
from tests.learner.examples import adversarial
from tests.learner.forms import (
    JIT_OFF,
    RADII,
    Floats,
    Twins,
    answer,
    brute_force,
    canonical,
    examples,
    grids,
    scan_nothing,
)


def check_each_insertion(points: Floats, built: int, radii: list[float], *, keep_covered: bool) -> Twins:
    """The first samples are built at once, the others inserted."""
    twins = Twins(points[:built], radii, keep_covered=keep_covered)
    for i in range(built, len(points)):
        twins.insert(points[i])
        twins.same()
        twins.same_answers((points[i] + 0.25).tolist(), 3, 4)
    return twins


@given(
    points=st.integers(1, 3).flatmap(grids),
    built=st.integers(0, 40),
    radii=st.sampled_from(RADII),
    keep=st.booleans(),
)
@examples(150)
def test_is_the_literal_tree_after_every_sample(points: Floats, built: int, radii: list[float], keep: bool) -> None:
    twins = check_each_insertion(points, min(built, len(points)), radii, keep_covered=keep)
    twins.repair()
    twins.same()
    assert twins.fast.statistics().invisible == 0
    assert canonical(twins.fast) == canonical(rpt.build(points, radii=radii, keep_covered=keep))


@pytest.mark.parametrize("case", adversarial())
@pytest.mark.parametrize("share", [0.0, 0.5], ids=["all inserted", "half built"])
def test_is_the_literal_tree_on_adversarial_inputs(case: str, share: float) -> None:
    points = adversarial()[case]
    for radii in RADII[2:3] if JIT_OFF else RADII[1:4]:
        check_each_insertion(points, int(share * len(points)), radii, keep_covered=True)


@given(seed=st.integers(0, 10**6), d=st.integers(1, 4), built=st.integers(0, 30))
@examples(40)
def test_repair_gives_back_what_was_invisible(seed: int, d: int, built: int) -> None:
    points = np.random.default_rng(seed).normal(size=(60, d))
    radii = [2.0, 1.0, 0.5]
    twins = check_each_insertion(points, built, radii, keep_covered=True)
    twins.repair()
    twins.same()
    assert twins.fast.statistics().invisible == 0
    assert twins.literal.misfiled() == []
    found = twins.fast.beam(points, 1).ids[:, 0]
    assert found.tolist() == list(range(60))


def test_some_nodes_do_become_invisible() -> None:
    points = np.random.default_rng(1).normal(size=(60, 2))
    twins = check_each_insertion(points, 0, [2.0, 1.0, 0.5], keep_covered=True)
    assert twins.fast.statistics().invisible > 0
    # Their samples are still found by the exact search, not by descent.
    assert np.array_equal(twins.fast.exact(points, 1).ids[:, 0], np.arange(60))
    assert not np.array_equal(twins.fast.beam(points, 1).ids[:, 0], np.arange(60))


def test_what_a_leaf_covered_stays_with_it_until_a_repair() -> None:
    # 3 is covered by 0; then 4 splits the leaf, and 3 is nearer to it.
    tree = rpt.build([[0.0], [3.0]], radii=[8.0, 3.5])
    tree.insert([4.0])
    assert canonical(tree) == (0, -1, ((1, 0, ((2, 0, (), (1,)), (2, 2, (), ())), ()),), ())
    assert tree.beam([3.0], 1).ids.tolist() == [2]
    tree.repair()
    assert canonical(tree) == (0, -1, ((1, 0, ((2, 0, (), ()), (2, 2, (), (1,))), ()),), ())
    assert tree.beam([3.0], 1).ids.tolist() == [1]


def test_many_at_once_are_one_after_the_other() -> None:
    points = np.random.default_rng(2).normal(size=(200, 2))
    together, single = (rpt.build(points[:20], radii=[1.0, 0.3]) for _ in range(2))
    assert together.insert(points[20:]).tolist() == list(range(20, 200))
    for i in range(20, 200):
        assert single.insert(points[i]).tolist() == [i]
    assert canonical(together) == canonical(single)
    assert np.array_equal(together.points, points)
    assert together.insert(np.zeros((0, 2))).tolist() == []


# --- where pages, groups and the page of all samples become full ------------------------------------------------------


def orders(n: int) -> dict[str, Floats]:
    rng = np.random.default_rng(3)
    return {
        "scattered": rng.normal(size=(n, 2)),
        "ascending": np.linspace(0, 1, n)[:, np.newaxis],
        "descending": np.linspace(1, 0, n)[:, np.newaxis],
        "identical": np.ones((n, 3)),
        "few places": rng.integers(0, 3, size=(n, 2)).astype(np.float64),
    }


@pytest.mark.parametrize("case", orders(1))
@pytest.mark.parametrize("radii", [[100.0], [1.0, 0.2]], ids=["one leaf", "many leaves"])
def test_exact_is_brute_force_while_leaves_outgrow_their_pages(case: str, radii: list[float]) -> None:
    page, group, flat = layout.PAGE_LANES, layout.GROUP_LANES, layout.FLAT_LANES
    n = flat + 2 * page if JIT_OFF else 3 * page * group
    points = orders(n)[case]
    turns = {1, 2, 8, 9, page - 1, page, page + 1, 2 * page + 1, flat - 1, flat, flat + 1, page * group + 1, n}
    scanning, descending = (rpt.build(points[:0], radii=radii) for _ in range(2))
    for tree in (scanning, scan_nothing(descending)):
        for i in range(n):
            tree.insert(points[i])
            if i + 1 in turns:
                for query in (points[i], points[0] + 0.1, points[i // 2]):
                    for k in {1, min(7, i + 1), min(page + 1, i + 1)}:
                        assert answer(tree.exact(query, k)) == brute_force(points[: i + 1], query, k)
    assert scanning.exact(points[0], n).ids.tolist() == brute_force(points, points[0], n)[0]
    assert canonical(scanning) == canonical(descending)
    literal = reference.Tree(radii)
    for point in points:
        literal.insert(point.tolist())
    assert canonical(scanning) == literal.canonical()


def test_a_leaf_of_very_many_equal_samples_can_be_listed() -> None:
    # Its groups hang one below the other, deeper than this Python may recurse.
    n = 1500 if JIT_OFF else 40_000
    tree = rpt.build(np.ones((1, 1)), radii=[1.0])
    tree.insert(np.ones((n - 1, 1)))
    frames, frame = 0, sys._getframe()
    while frame.f_back:
        frames, frame = frames + 1, frame.f_back
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(frames + 60)
    try:
        members = tree.nodes().members
    finally:
        sys.setrecursionlimit(limit)
    assert members == ((), tuple(range(n)))


def test_reserve_keeps_the_storage_in_place() -> None:
    points = np.random.default_rng(4).normal(size=(500, 2))
    tree = rpt.build(points[:3], radii=[1.0])
    tree.reserve(497)
    storage = tree.storage
    tree.insert(points[3:])
    assert tree.storage is storage
    assert np.array_equal(tree.points, points)
    tree.insert(points)
    assert np.array_equal(tree.points, np.concatenate([points, points]))


# --- bad input --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ([1.0], "2 components"),
        ([[1.0], [2.0]], "2 components"),
        (3.0, "2 components"),
        ([], "2 components"),
        (np.zeros((1, 2, 2)), "2 components"),
        ([[0.0, 0.0], [0.0, np.nan]], r"number \[1, 1\] is nan"),
        ([np.inf, 0.0], "finite"),
        ([1e151, 0.0], "magnitude"),
        ([1j, 0.0], "real numbers"),
        (np.array([1j, 0.0]), "real numbers"),
        (["x", "y"], "could not convert"),
        ([None, 0.0], "finite"),
    ],
)
def test_bad_input_is_an_error_and_nothing_is_inserted(inputs: Any, message: str) -> None:
    tree = rpt.build([[0.0, 0.0]])
    with pytest.raises(ValueError, match=message):
        tree.insert(inputs)
    assert (tree.samples, len(tree.points), len(tree.alive)) == (1, 1, 1)
    assert tree.insert([5.0, 5.0]).tolist() == [1]
