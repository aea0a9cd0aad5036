"""The thesis's own example: construction, Figs 3.19 to 3.35; retrieval, 3.14 to 3.17; the miss, 3.36.

The scanned figures are lost; the coordinates are ours, chosen so that everything happens as the captions say.
"""

from __future__ import annotations

import numpy as np
import pytest

from handeye import rpt

SAMPLES = {
    "A": (0.0, 0.0),
    "B": (20.0, 0.0),
    "a": (-6.0, 1.0),
    "b": (1.0, -6.0),
    "C": (10.0, 20.0),
    "c": (20.0, -6.0),
    "d": (5.0, 5.0),
    "e": (24.0, 5.0),
    "alpha": (6.5, 5.0),
    "beta": (5.0, 6.5),
    "chi": (3.5, 5.0),
    "delta": (5.0, 3.5),
    "f": (5.0, 22.0),
    "epsilon": (24.0, 6.5),
    "g": (15.0, 22.0),
    "phi": (5.3, 5.3),
}
NAMES = list(SAMPLES)
POINTS = np.array(list(SAMPLES.values()))
RADII = (10.0, 4.0, 1.0)


def children(tree: rpt.Tree) -> dict[str, list[str]]:
    """Names of each node's children, by the node's name and level: 'd/2'."""

    def name(node: int | np.signedinteger) -> str:
        return f"{NAMES[tree.sample[node]] if node else 'root'}/{tree.level[node]}"

    found = {}
    for node in np.flatnonzero(tree.child_count):
        first = tree.first_child[node]
        found[name(node)] = [name(child) for child in range(first, first + tree.child_count[node])]
    return found


LEVEL_1 = {"root/0": ["A/1", "B/1", "C/1"]}
LEVEL_2 = {
    "A/1": ["A/2", "a/2", "b/2", "d/2"],
    "B/1": ["B/2", "c/2", "e/2"],
    "C/1": ["C/2", "f/2", "g/2"],
}
LEVEL_3 = {
    "d/2": ["d/3", "alpha/3", "beta/3", "chi/3", "delta/3"],
    "e/2": ["e/3", "epsilon/3"],
}


@pytest.mark.parametrize(
    ("levels", "expected"),
    [(1, LEVEL_1), (2, LEVEL_1 | LEVEL_2), (3, LEVEL_1 | LEVEL_2 | LEVEL_3)],
    ids=["Fig 3.22", "Fig 3.29", "Fig 3.35"],
)
def test_construction(levels: int, expected: dict[str, list[str]]) -> None:
    assert children(rpt.build(POINTS, radii=RADII[:levels])) == expected


def test_phi_is_covered_by_d() -> None:
    tree = rpt.build(POINTS, radii=RADII)
    phi = NAMES.index("phi")
    assert phi not in tree.sample
    leaf = next(n for n in np.flatnonzero(tree.child_count == 0) if phi in members(tree, n))
    assert (NAMES[tree.sample[leaf]], tree.level[leaf]) == ("d", 3)
    assert phi not in rpt.build(POINTS, radii=RADII, keep_covered=False).members


def members(tree: rpt.Tree, node: int | np.signedinteger) -> list[int]:
    start = tree.first_member[node]
    return tree.members[start : start + tree.member_count[node]].tolist()  # type: ignore[no-any-return]


def test_levels_are_not_equally_deep() -> None:
    tree = rpt.build(POINTS, radii=RADII)
    levels = {NAMES[tree.sample[n]]: int(tree.level[n]) for n in np.flatnonzero(tree.child_count == 0)}
    assert levels["a"] == levels["C"] == 2
    assert levels["delta"] == levels["epsilon"] == 3


def test_retrieval_goes_from_a_to_d_to_delta() -> None:
    tree = rpt.build(POINTS, radii=RADII, keep_covered=False)
    found = rpt.query_beam(tree, [5.2, 3.0], 1)
    assert NAMES[found.ids[0]] == "delta"


def test_the_miss_of_fig_3_36() -> None:
    # e is nearer to B than to C and so below B; the query is nearer to C, and to e than to any other sample.
    names = ["B", "C", "e", "f"]
    points = np.array([[0.0, 0.0], [20.0, 0.0], [9.5, 0.0], [15.0, 0.0]])
    tree = rpt.build(points, radii=[12.0, 4.0])
    query = [10.5, 0.0]
    assert names[rpt.query_beam(tree, query, 1).ids[0]] == "f"
    assert names[rpt.query_exact(tree, query, 1).ids[0]] == "e"
    assert names[rpt.query_beam(tree, query, 1, width=2).ids[0]] == "e"
