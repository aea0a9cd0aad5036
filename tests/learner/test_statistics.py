"""Figures about trees (3.4, Appendix B) against the literal tree."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handeye import rpt
from tests.learner import reference
from tests.learner.examples import ADOPTION, ADOPTION_RADII, adversarial
from tests.learner.forms import RADII, Floats, Twins, canonical, examples, grids


def diameter(points: Floats, samples: list[int]) -> float:
    """Of the box around samples."""
    chosen = points[samples]
    return float(np.linalg.norm(chosen.max(axis=0) - chosen.min(axis=0))) if samples else 0.0


def kappas(tree: reference.Tree) -> list[float]:
    """(2 max V / r)^N for each level, as far down as there are cells above."""
    points = np.array(tree.points)
    bounds = []
    for level, radius in enumerate(tree.radii, start=1):
        above = [node for node in [tree.root, *tree.nodes()] if node.level == level - 1]
        if not above:
            break
        widest = max(diameter(points, tree.filed(node)) for node in above)
        ratio = 2 * widest / radius if radius else math.inf if widest else 0.0
        bounds.append(ratio ** points.shape[1])
    return bounds


def check(fast: rpt.Tree, literal: reference.Tree) -> None:
    figures = fast.statistics()
    nodes = literal.nodes()
    inner = [len(node.children) for node in [literal.root, *nodes] if node.children]
    assert figures.levels == max((node.level for node in nodes), default=0)
    assert figures.nodes == len(nodes)
    assert figures.leaves == sum(not node.children for node in nodes)
    assert figures.samples == len(literal.filed(literal.root))
    assert figures.widest == max(inner, default=0)
    assert figures.fan_out == pytest.approx(np.mean(inner) if inner else 0.0)
    assert figures.invisible == len(literal.invisible())


@given(points=st.integers(1, 3).flatmap(grids), built=st.integers(1, 40), radii=st.sampled_from(RADII))
@examples(100)
def test_figures_are_those_of_the_literal_tree(points: Floats, built: int, radii: list[float]) -> None:
    twins = Twins(points[:built], radii)
    check(twins.fast, twins.literal)
    assert twins.fast.statistics().kappa == pytest.approx(kappas(twins.literal))
    twins.insert(points[built:])
    check(twins.fast, twins.literal)
    twins.remove(range(0, len(points), 3))
    check(twins.fast, twins.literal)
    twins.repair()
    check(twins.fast, twins.literal)
    if twins.living():
        assert twins.fast.statistics().kappa == pytest.approx(kappas(twins.literal))


@pytest.mark.parametrize("case", adversarial())
def test_kappa_bounds_the_children(case: str) -> None:
    points = adversarial()[case]
    twins = Twins(points, [8.0, 4.0, 2.0, 1.0, 0.5])
    bounds = twins.fast.statistics().kappa
    assert bounds == pytest.approx(kappas(twins.literal))
    nodes = twins.fast.nodes()
    for level, bound in enumerate(bounds):
        # The count of disjoint balls, which is certain; kappa itself is an estimate.
        here = nodes.child_count[nodes.level == level]
        sure = (1 + bound ** (1 / points.shape[1])) ** points.shape[1]
        assert here.max(initial=0) <= sure * (1 + 1e-9)


def test_kappa_by_hand() -> None:
    # Level 1: 0 and 10, and the root's cell is 12 long; level 2: the cell of 10 is 2 long, that of 0 is 1 long.
    tree = rpt.build([[0.0], [10.0], [1.0], [12.0]], radii=[5.0, 0.5])
    assert tree.statistics().kappa == (2 * 12 / 5, 2 * 2 / 0.5)
    assert rpt.build([[0.0, 0.0], [3.0, 4.0]], radii=[2.0, 0.0]).statistics().kappa == ((2 * 5 / 2) ** 2, 0.0)
    assert rpt.build([[0.0], [1.0]], radii=[0.0]).statistics().kappa == (math.inf,)


def test_figures_by_hand() -> None:
    figures = rpt.build([[0.0], [10.0], [1.0], [10.5]], radii=[5.0, 0.8]).statistics()
    # Level 1: 0 and 10; level 2: 0 splits into 0 and 1; 10.5 is covered by 10.
    assert figures[:6] == (2, 4, 3, 4, 2, 2.0)
    assert figures.invisible == 0


def test_invisible_nodes_are_counted_and_repaired() -> None:
    tree = rpt.build(np.zeros((0, 2)), radii=ADOPTION_RADII)
    tree.insert(list(ADOPTION.values()))
    assert tree.statistics().invisible == 3
    tree.repair()
    assert tree.statistics().invisible == 0


@pytest.mark.parametrize("n", [1, 100, 700])
def test_bytes_lie_between_the_samples_and_what_is_allocated(n: int) -> None:
    d = 3
    tree = rpt.build(np.random.default_rng(1).normal(size=(n, d)))
    for _ in range(2):
        used = tree.statistics().bytes
        arrays = [tree.storage, tree.slots, tree.alive, *tree.arenas]
        # Each vector is kept once in order and once in its leaf.
        assert 2 * 8 * n * d < used <= sum(array.nbytes for array in arrays)
        assert used < 8 * n * (6 * d + 8) + 50_000
        tree.insert(np.random.default_rng(2).normal(size=(n, d)))
        assert tree.statistics().bytes > used
        n *= 2


# --- the list of nodes ------------------------------------------------------------------------------------------------


def test_nodes_stand_breadth_first_in_the_order_of_their_making() -> None:
    points = np.random.default_rng(1).normal(size=(300, 3))
    nodes = rpt.build(points, radii=[2.0, 1.0, 0.5]).nodes()
    assert (nodes.sample[0], nodes.level[0], nodes.parent[0]) == (-1, 0, -1)
    assert np.all(np.diff(nodes.level) >= 0)
    assert np.all(np.diff(nodes.parent) >= 0)
    assert np.array_equal(nodes.level[1:], nodes.level[nodes.parent[1:]] + 1)
    assert np.array_equal(np.bincount(nodes.parent[1:], minlength=len(nodes.parent)), nodes.child_count)
    assert all((count == 0) == (len(members) > 0) for count, members in zip(*nodes[3:], strict=True))
    assert sorted(sample for leaf in nodes.members for sample in leaf) == list(range(300))
    assert all(leaf == tuple(sorted(leaf)) for leaf in nodes.members)


def test_a_node_that_splits_is_its_own_first_child() -> None:
    nodes = rpt.build(np.random.default_rng(1).normal(size=(300, 3)), radii=[2.0, 1.0, 0.5]).nodes()
    split = np.flatnonzero(nodes.child_count)[1:]
    assert len(split) > 10
    first = [int(np.flatnonzero(nodes.parent == node)[0]) for node in split]
    assert np.array_equal(nodes.sample[first], nodes.sample[split])


def test_looking_at_a_tree_does_not_change_it() -> None:
    tree = rpt.build(np.random.default_rng(1).normal(size=(100, 2)), radii=[1.0, 0.3])
    before = canonical(tree)
    first, second = tree.statistics(), tree.statistics()
    assert first == second
    assert canonical(tree) == before
