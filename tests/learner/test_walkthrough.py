"""The thesis's own examples: construction, Figs 3.19 to 3.35; retrieval, 3.14 to 3.17; the miss, 3.36; adoption, B.1.

Both the literal tree and the library's must do what captions and text say.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from handeye import rpt
from tests.learner import examples
from tests.learner.forms import canonical
from tests.learner.reference import Canonical, Tree, build, steps

NAMES = list(examples.WALKTHROUGH)
POINTS = np.array(list(examples.WALKTHROUGH.values()))
RADII = examples.WALKTHROUGH_RADII


def children(form: Canonical) -> dict[str, list[str]]:
    """Names of each node's children, by the node's name and level: 'd/2'."""

    def name(level: int, sample: int) -> str:
        return f"{NAMES[sample]}/{level}" if level else "root"

    level, sample, below, _ = form
    found = {name(level, sample): [name(child[0], child[1]) for child in below]} if below else {}
    return found | {key: names for child in below for key, names in children(child).items()}


LEVEL_1 = {"root": ["A/1", "B/1", "C/1"]}
LEVEL_2 = {
    "A/1": ["A/2", "a/2", "b/2", "d/2"],
    "B/1": ["B/2", "c/2", "e/2"],
    "C/1": ["C/2", "f/2", "g/2"],
}
LEVEL_3 = {
    "d/2": ["d/3", "α/3", "β/3", "χ/3", "δ/3"],
    "e/2": ["e/3", "ε/3"],
}


def test_figs_3_19_to_3_35_step_by_step() -> None:
    considered = [(level, NAMES[sample], new) for _, level, sample, new in steps(POINTS, RADII)]
    added = [(level, name) for level, name, new in considered if new]
    refused = [(level, name) for level, name, new in considered if not new]
    assert added == [(level, name) for _, level, name in examples.ADDED]
    # The captions of Figs 3.22, 3.28, 3.29 and 3.35 name these.
    assert {(1, "a"), (1, "b"), (2, "α"), (2, "β"), (2, "χ"), (2, "δ"), (2, "ε"), (3, "φ")} <= set(refused)
    assert [(level, name) for level, name, _ in considered] == [(level, name) for level in (1, 2, 3) for name in NAMES]


def test_the_reasons_given_in_3_2_3() -> None:
    for tree, level, sample, _ in steps(POINTS, RADII):
        if level == 1 and sample == 0:
            assert children(tree.canonical()) == {"root": ["A/1"]}
        if level == 1 and NAMES[sample] == "C":
            others = tree.root.children[:-1]
            assert [NAMES[node.sample] for node in others] == ["A", "B"]
            assert NAMES[tree.nearest(others, tree.points[sample]).sample] == "B"
        if level == 2 and NAMES[sample] in "αβχδ":
            # Here the scan reads "their nearest neighbor, g", but g comes last: d is meant.
            leaf = tree.path(tree.points[sample])[-1]
            assert NAMES[leaf.sample] == "d"
            assert "g" not in [NAMES[node.sample] for node in tree.nodes()]
            assert math.dist(tree.points[leaf.sample], tree.points[sample]) < RADII[1]


@pytest.mark.parametrize(
    ("levels", "expected"),
    [(1, LEVEL_1), (2, LEVEL_1 | LEVEL_2), (3, LEVEL_1 | LEVEL_2 | LEVEL_3)],
    ids=["Fig 3.22", "Fig 3.29", "Fig 3.35"],
)
def test_the_tree_after_each_level(levels: int, expected: dict[str, list[str]]) -> None:
    literal = build(POINTS, RADII[:levels]).canonical()
    assert children(literal) == expected
    assert canonical(rpt.build(POINTS, radii=RADII[:levels])) == literal


def test_phi_is_covered_by_d() -> None:
    leaves = {node.sample: node for node in build(POINTS, RADII).nodes() if not node.children}
    assert [NAMES[sample] for sample in leaves[NAMES.index("d")].covered] == ["φ"]
    assert not any(leaf.covered for sample, leaf in leaves.items() if NAMES[sample] != "d")
    dropped = rpt.build(POINTS, radii=RADII, keep_covered=False)
    assert canonical(dropped) == build(POINTS, RADII, keep_covered=False).canonical()
    assert dropped.samples == len(NAMES) - 1


def test_leaves_lie_on_different_levels() -> None:
    levels = {NAMES[node.sample]: node.level for node in build(POINTS, RADII).nodes() if not node.children}
    assert levels["a"] == levels["C"] == 2
    assert levels["δ"] == levels["ε"] == 3


def test_retrieval_of_figs_3_14_to_3_17() -> None:
    fast, literal = rpt.build(POINTS, radii=RADII), build(POINTS, RADII)
    query = examples.WALKTHROUGH_QUERY
    for level, name in [(1, "A"), (2, "d"), (3, "δ")]:
        assert NAMES[int(fast.at_level(query, level))] == NAMES[literal.at_level(query, level)] == name
    assert fast.beam(query, 1).ids.tolist() == [NAMES.index("δ")]
    assert literal.beam(query, 1, 1)[0][0] == NAMES.index("δ")


def test_the_miss_of_fig_3_36() -> None:
    names, points = list(examples.MISS), np.array(list(examples.MISS.values()))
    fast, literal = rpt.build(points, radii=examples.MISS_RADII), build(points, examples.MISS_RADII)
    query = examples.MISS_QUERY
    assert canonical(fast) == literal.canonical()
    for width, name in [(1, "f"), (2, "e")]:
        found = fast.beam(query, 1, width)
        assert names[found.ids[0]] == name
        assert [(found.ids[0], found.distances[0])] == literal.beam(query, 1, width)
    assert names[fast.exact(query, 1).ids[0]] == names[literal.exact(query, 1)[0][0]] == "e"


def test_the_adoption_of_fig_b_1() -> None:
    names, points = list(examples.ADOPTION), list(examples.ADOPTION.values())
    fast, literal = rpt.build(points[:1], radii=examples.ADOPTION_RADII), Tree(examples.ADOPTION_RADII)
    literal.insert(points[0])
    hidden = []
    for point in points[1:]:
        fast.insert(point)
        literal.insert(point)
        assert canonical(fast) == literal.canonical()
        assert fast.statistics().invisible == len(literal.invisible())
        hidden.append(len(literal.invisible()))
    assert names[-1] == "C"
    assert hidden == [0, 0, 0, 0, 3]
    fast.repair()
    literal.repair()
    assert canonical(fast) == literal.canonical()
    assert fast.statistics().invisible == len(literal.invisible()) == 0
