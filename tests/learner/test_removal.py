"""Samples taken out: they answer nothing from the next query on; nodes that hold them go on showing the way."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handeye import rpt
from handeye.rpt.kernels import layout
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

Action = tuple[str, int]
actions = st.lists(
    st.tuples(st.sampled_from(["insert"] * 5 + ["remove"] * 4 + ["repair"]), st.integers(0, 10**6)), max_size=40
)


@given(
    points=st.integers(1, 2).flatmap(lambda d: grids(d, least=10)),
    built=st.integers(0, 20),
    happening=actions,
    radii=st.sampled_from(RADII),
    keep=st.booleans(),
)
@examples(150)
def test_whatever_happens_it_is_the_literal_tree(
    points: Floats, built: int, happening: list[Action], radii: list[float], keep: bool
) -> None:
    twins = Twins(points[:built], radii, keep_covered=keep)
    for what, number in happening:
        living = twins.living()
        if what == "insert":
            twins.insert(points[number % len(points)])
        elif what == "repair":
            twins.repair()
        elif living:
            twins.remove([living[number % len(living)]])
        twins.same()
        twins.same_answers(points[number % len(points)].tolist(), 4, 5)
    twins.repair()
    twins.same()
    living = twins.living()
    fresh = rpt.build(twins.fast.points[living], radii=radii, keep_covered=keep)
    assert fresh.statistics()[:-1] == twins.fast.statistics()[:-1]
    assert [
        -1 if sample < 0 else living[sample] for sample in fresh.nodes().sample
    ] == twins.fast.nodes().sample.tolist()


@pytest.mark.parametrize("n", [20, layout.PAGE_LANES + 6, layout.FLAT_LANES + 20] + [3000] * (not JIT_OFF))
@pytest.mark.parametrize("radii", [[100.0], [0.7, 0.2]], ids=["one leaf", "many leaves"])
def test_exact_is_brute_force_over_the_living(n: int, radii: list[float]) -> None:
    rng = np.random.default_rng(n)
    points = rng.integers(-20, 21, size=(2 * n, 2)) / 10
    tree, living = rpt.build(points[:n], radii=radii), set(range(n))

    def check() -> None:
        assert tree.samples == len(living)
        assert np.array_equal(np.flatnonzero(tree.alive), sorted(living))
        for query in rng.normal(size=(8, 2)):
            for k in {1, min(9, len(living)), min(100, len(living))}:
                assert answer(tree.exact(query, k)) == brute_force(tree.points, query, k, living)

    for step in range(4):
        gone = rng.choice(sorted(living), size=n // 5, replace=False)
        tree.remove(gone)
        living -= set(gone.tolist())
        check()
        living |= set(tree.insert(points[n + step * n // 4 : n + (step + 1) * n // 4]).tolist())
        check()
    tree.repair()
    check()
    assert tree.exact([0.0, 0.0], len(living)).ids.tolist() == brute_force(tree.points, [0.0, 0.0], 2 * n, living)[0]


def test_a_removed_sample_shows_the_way_until_a_repair() -> None:
    tree = scan_nothing(rpt.build([[0.0], [10.0], [11.0]], radii=[5.0]))
    tree.remove(1)
    assert tree.nodes().sample.tolist() == [-1, 0, 1]
    assert tree.nodes().members == ((), (0,), (2,))
    assert tree.at_level([10.0], 1) == 1
    assert tree.beam([10.0], 1).ids.tolist() == tree.exact([10.0], 1).ids.tolist() == [2]
    # The next sample is still judged by it: within 5 of 10, so no new node.
    tree.insert([14.5])
    assert tree.nodes().sample.tolist() == [-1, 0, 1]
    tree.repair()
    assert tree.nodes().sample.tolist() == [-1, 0, 2]
    assert tree.at_level([10.0], 1) == 2


def test_a_beam_may_end_where_nobody_lives() -> None:
    tree = rpt.build([[0.0], [10.0], [20.0]], radii=[5.0])
    tree.remove(1)
    assert answer(tree.beam([10.0], 1)) == ([-1], [math.inf])
    assert answer(tree.beam([10.0], 2, 2)) == ([0, -1], [10.0, math.inf])
    assert answer(tree.beam([10.0], 2, 3)) == ([0, 2], [10.0, 10.0])


@pytest.mark.parametrize("n", [30, 700])
@pytest.mark.parametrize("keep", [True, False], ids=["kept", "dropped"])
def test_everything_can_be_removed(n: int, keep: bool) -> None:
    points = np.random.default_rng(5).normal(size=(n, 2))
    tree = rpt.build(points, radii=[1.0, 0.1], keep_covered=keep)
    tree.remove(np.arange(n))
    for _ in range(2):
        assert tree.samples == tree.statistics().samples == 0
        with pytest.raises(ValueError, match="the 0 samples in the tree"):
            tree.exact([0.0, 0.0], 1)
        with pytest.raises(ValueError, match="the 0 samples in the tree"):
            tree.beam([0.0, 0.0], 1)
        tree.repair()
    assert canonical(tree) == (0, -1, (), ())
    figures = tree.statistics()
    assert (figures.nodes, figures.leaves, figures.levels, figures.widest, figures.fan_out) == (0, 0, 0, 0, 0.0)
    assert tree.insert([1.0, 1.0]).tolist() == [n]
    assert answer(tree.exact([1.0, 2.0], 1)) == ([n], [1.0])


def test_insertion_where_everything_was_removed() -> None:
    tree = rpt.build([[0.0], [10.0]], radii=[5.0, 1.0])
    tree.remove([0, 1])
    assert tree.insert([[2.0], [30.0]]).tolist() == [2, 3]
    # 2 stands below the signpost 0, which is still there.
    assert canonical(tree) == (
        0,
        -1,
        ((1, 0, ((2, 0, (), ()), (2, 2, (), ())), ()), (1, 1, (), ()), (1, 3, (), ())),
        (),
    )
    assert tree.exact([0.0], 2).ids.tolist() == [2, 3]


def test_a_dropped_sample_comes_back_when_the_one_that_covered_it_is_gone() -> None:
    tree = rpt.build([[0.0], [1.0], [9.0]], radii=[3.0], keep_covered=False)
    tree.remove(0)
    assert (tree.samples, tree.exact([1.0], 1).ids.tolist()) == (1, [2])
    tree.repair()
    assert (tree.samples, tree.exact([1.0], 1).ids.tolist()) == (2, [1])


def test_a_dropped_sample_can_be_removed() -> None:
    tree = rpt.build([[0.0], [1.0], [9.0]], radii=[3.0], keep_covered=False)
    tree.remove(1)
    assert (tree.samples, tree.alive.tolist()) == (2, [True, False, True])
    tree.remove(0)
    tree.repair()
    assert (tree.samples, tree.exact([1.0], 1).ids.tolist()) == (1, [2])


@pytest.mark.parametrize(
    ("ids", "error"),
    [
        (3, ValueError),
        (-1, ValueError),
        ([0, 0], ValueError),
        ([[0, 2], [0, 2]], ValueError),
        ([0, 1], ValueError),
        ([0, 7], ValueError),
        (np.uint64(2**63), ValueError),
        ([0.7], TypeError),
        ([True, False, False], TypeError),
        (["0"], TypeError),
        (None, TypeError),
        ([math.nan], TypeError),
    ],
    ids=str,
)
def test_bad_numbers_are_errors_and_nothing_is_removed(ids: Any, error: type[Exception]) -> None:
    tree = rpt.build([[0.0], [1.0], [2.0]])
    tree.remove(1)
    with pytest.raises(error, match="removed"):
        tree.remove(ids)
    assert tree.samples == 2
    assert tree.exact([0.0], 2).ids.tolist() == [0, 2]


def test_removing_nothing_is_fine() -> None:
    tree = rpt.build([[0.0], [1.0]])
    tree.remove([])
    tree.remove([[0]])
    assert tree.alive.tolist() == [False, True]
