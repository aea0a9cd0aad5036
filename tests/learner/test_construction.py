"""Batch construction against a slow, literal transcription of Fig 3.18."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from handeye import rpt

Points = Sequence[Sequence[float]]


# --- the reference: nothing of ours in it ---------------------------------------------------------------------------


@dataclass(eq=False)
class Node:
    sample: int
    level: int
    parent: Node | None = None
    children: list[Node] = field(default_factory=list)
    covered: list[int] = field(default_factory=list)

    def shape(self) -> tuple[int, int, list[object]]:
        return (self.sample, self.level, [child.shape() for child in self.children])


def distance(a: Sequence[float], b: Sequence[float]) -> float:
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total += (x - y) * (x - y)
    return math.sqrt(total)


def descend(root: Node, points: Points, q: int) -> Node:
    """Uses Q as a query into the existing tree until a leaf is reached (3.2.2)."""
    node = root
    while node.children:
        node = min(node.children, key=lambda child: (distance(points[child.sample], points[q]), child.sample))
    return node


def construct(points: Points, radii: Sequence[float]) -> Node:
    root = Node(sample=-1, level=0)
    for level, radius in enumerate(radii, start=1):
        for q in range(len(points)):
            x = descend(root, points, q)
            if x is root:
                root.children.append(Node(q, level, root))
                continue
            far = distance(points[x.sample], points[q]) > radius
            if x.level < level - 1:
                continue
            if x.level == level - 1 and far:
                x.children += [Node(x.sample, level, x), Node(q, level, x)]
            elif x.level == level and far:
                assert x.parent is not None
                x.parent.children.append(Node(q, level, x.parent))
    for q in range(len(points)):
        descend(root, points, q).covered.append(q)
    return root


# --- what the product built, in the same form -----------------------------------------------------------------------


def shape(tree: rpt.Tree, node: int = 0) -> tuple[int, int, list[object]]:
    first = tree.first_child[node]
    children = [shape(tree, child) for child in range(first, first + tree.child_count[node])]
    return (int(tree.sample[node]), int(tree.level[node]), list(children))


def leaf_contents(tree: rpt.Tree) -> dict[int, list[int]]:
    """Samples by the sample that their leaf holds."""
    contents = {}
    for node in np.flatnonzero(tree.child_count == 0):
        start = tree.first_member[node]
        contents[int(tree.sample[node])] = tree.members[start : start + tree.member_count[node]].tolist()
    return contents


def reference_contents(node: Node) -> dict[int, list[int]]:
    if not node.children:
        return {node.sample: node.covered}
    return {sample: covered for child in node.children for sample, covered in reference_contents(child).items()}


def check_same(points: NDArray[np.float64], radii: Sequence[float]) -> None:
    tree = rpt.build(points, radii=radii)
    expected = construct(points.tolist(), radii)
    assert shape(tree) == expected.shape()
    assert leaf_contents(tree) == reference_contents(expected)


RADII = [[3.0], [4.0, 2.0, 1.0], [8.0, 4.0, 2.0, 1.0, 0.5], [1.5, 0.0], [math.sqrt(2), 1.0]]

# Points on a coarse grid: duplicates, collinear points and equal distances are the rule, not the exception.
grids = st.integers(1, 3).flatmap(
    lambda d: st.lists(st.lists(st.integers(-6, 6).map(float), min_size=d, max_size=d), min_size=1, max_size=40)
)


@given(points=grids, radii=st.sampled_from(RADII))
@settings(deadline=None, max_examples=150)
def test_is_the_literal_tree_node_by_node(points: list[list[float]], radii: list[float]) -> None:
    check_same(np.array(points), radii)


@given(seed=st.integers(0, 10**6), n=st.integers(1, 60), d=st.integers(1, 5))
@settings(deadline=None, max_examples=50)
def test_is_the_literal_tree_on_random_points_with_derived_radii(seed: int, n: int, d: int) -> None:
    points = np.random.default_rng(seed).normal(size=(n, d))
    check_same(points, rpt.derive_radii(points).tolist())


def adversarial() -> dict[str, NDArray[np.float64]]:
    rng = np.random.default_rng(5)
    scattered = rng.normal(size=(50, 2)) * 4
    line = np.outer(np.linspace(0, 12, 49), [3.0, -1.0])
    return {
        "one sample": np.zeros((1, 3)),
        "all the same": np.ones((30, 2)),
        "duplicates": np.repeat(scattered[:10], 4, axis=0),
        "collinear": line,
        "collinear, reversed": line[::-1],
        "scattered": scattered,
        "scattered, reversed": scattered[::-1],
        "two far clusters": np.concatenate([scattered * 0.1, scattered * 0.1 + 1000.0]),
        "a geometric sequence": 2.0 ** np.arange(-10, 30)[:, np.newaxis],
    }


@pytest.mark.parametrize("case", adversarial())
@pytest.mark.parametrize("radii", [*RADII, None], ids=str)
def test_is_the_literal_tree_on_adversarial_inputs(case: str, radii: list[float] | None) -> None:
    points = adversarial()[case]
    check_same(points, rpt.derive_radii(points).tolist() if radii is None else radii)


def test_the_order_of_the_samples_shapes_the_tree() -> None:
    points = np.array([[0.0], [2.0], [4.0]])
    assert shape(rpt.build(points, radii=[3.0])) != shape(rpt.build(points[[1, 0, 2]], radii=[3.0]))


# --- the arrays -----------------------------------------------------------------------------------------------------


def scattered_tree(**options: bool) -> rpt.Tree:
    return rpt.build(np.random.default_rng(1).normal(size=(300, 3)), **options)


def test_a_node_that_splits_is_its_own_first_child() -> None:
    tree = scattered_tree()
    split = np.flatnonzero(tree.child_count)[1:]
    assert len(split) > 10
    assert np.array_equal(tree.sample[tree.first_child[split]], tree.sample[split])


def test_covering_radii_cover_exactly() -> None:
    tree = scattered_tree()

    def below(node: int) -> list[int]:
        if tree.child_count[node] == 0:
            start = tree.first_member[node]
            return tree.members[start : start + tree.member_count[node]].tolist()  # type: ignore[no-any-return]
        first = tree.first_child[node]
        return [sample for child in range(first, first + tree.child_count[node]) for sample in below(child)]

    for node in range(1, len(tree.sample)):
        distances = np.linalg.norm(tree.points[below(node)] - tree.points[tree.sample[node]], axis=1)
        assert tree.cover[node] == pytest.approx(distances.max(), abs=1e-12)
    assert sorted(below(0)) == list(range(300))


def test_covered_samples_are_kept_or_dropped() -> None:
    kept = scattered_tree()
    dropped = scattered_tree(keep_covered=False)
    assert shape(kept) == shape(dropped)
    assert sorted(kept.members.tolist()) == list(range(300))
    leaves = dropped.child_count == 0
    assert np.all(dropped.member_count[leaves] == 1)
    assert np.array_equal(dropped.members, dropped.sample[leaves])
    assert len(dropped.members) < 300


def test_the_tree_keeps_a_copy_of_its_inputs() -> None:
    points = np.zeros((2, 1))
    tree = rpt.build(points)
    points[0] = 9
    assert tree.points[0, 0] == 0


def test_statistics_count() -> None:
    tree = rpt.build([[0.0], [10.0], [1.0], [10.5]], radii=[5.0, 0.8])
    # Level 1: 0 and 10; level 2: 0 splits into 0 and 1; 10.5 is covered by 10.
    assert rpt.statistics(tree) == rpt.Statistics(levels=2, nodes=4, leaves=3, samples=4, widest=2)


# --- radii ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dimension", [1, 2, 3, 6])
def test_derived_radii_bound_the_fan_out(dimension: int) -> None:
    points = np.random.default_rng(2).uniform(size=(2000, dimension))
    tree = rpt.build(points)
    inner = tree.child_count[tree.child_count > 0]
    assert inner.mean() < 8
    assert inner.max() < 50
    assert tree.member_count.max() < 50


def test_derived_radii_fit_a_manifold_not_its_room() -> None:
    rng = np.random.default_rng(2)
    flat = rng.uniform(size=(2000, 2)) @ rng.normal(size=(2, 10))
    inner = rpt.build(flat).child_count
    assert inner.max() < 50


def test_derived_radii_scale_with_the_data() -> None:
    points = np.random.default_rng(2).normal(size=(100, 3))
    assert rpt.derive_radii(points * 8) == pytest.approx(rpt.derive_radii(points) * 8)


def test_derived_radii_of_coincident_samples() -> None:
    assert rpt.derive_radii(np.ones((5, 2))).tolist() == [0.0]
    assert rpt.derive_radii([[1.0]]).tolist() == [0.0]


# --- errors ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("inputs", "radii", "message"),
    [
        (np.zeros((0, 3)), None, "non-empty"),
        (np.zeros((3, 0)), None, "non-empty"),
        (np.zeros((2, 2, 2)), None, "non-empty"),
        ([[0.0, math.nan]], None, "finite"),
        ([[0.0, math.inf]], None, "finite"),
        ([[1e200]], None, "magnitude"),
        ([[0.0]], [], "radii"),
        ([[0.0]], [1.0, 1.0], "radii"),
        ([[0.0]], [1.0, -1.0], "radii"),
        ([[0.0]], [1.0, 2.0], "radii"),
        ([[0.0]], [math.nan], "radii"),
    ],
)
def test_bad_input_is_an_error(inputs: object, radii: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rpt.build(inputs, radii=radii)  # type: ignore[arg-type]


def test_fan_out_below_two_is_an_error() -> None:
    with pytest.raises(ValueError, match="fan_out"):
        rpt.derive_radii([[0.0], [1.0]], fan_out=1)


def test_a_row_of_numbers_is_samples_of_one_component() -> None:
    build: Callable[[object], rpt.Tree] = rpt.build  # type: ignore[assignment]
    assert build([1.0, 2.0, 3.0]).points.shape == (3, 1)
