"""The reference itself, on cases small enough to be followed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.learner import examples
from tests.learner.reference import Canonical, Tree, build, canonical_of, derived_points, leaf_map, map_query, spacing


def leaf(level: int, sample: int, *covered: int) -> Canonical:
    return (level, sample, (), covered)


def node(level: int, sample: int, *children: Canonical) -> Canonical:
    return (level, sample, children, ())


def root(*children: Canonical) -> Canonical:
    return node(0, -1, *children)


def line(*numbers: float) -> list[list[float]]:
    return [[number] for number in numbers]


# --- batch construction (3.2.3) ---------------------------------------------------------------------------------------


def test_batch_construction() -> None:
    # Level 1: 0 and 10. Level 2: 0 splits into 0 and 1; 10.5 is within 0.8 of 10.
    tree = build(line(0, 10, 1, 10.5), [5, 0.8])
    assert tree.canonical() == root(node(1, 0, leaf(2, 0), leaf(2, 2)), leaf(1, 1, 3))


def test_a_distance_equal_to_the_radius_is_covered() -> None:
    assert build(line(0, 3), [3]).canonical() == root(leaf(1, 0, 1))


def test_a_leaf_that_does_not_split_on_one_level_does_not_split_on_a_later_one() -> None:
    # On level 2 sample 1 is within T(2) of the leaf of level 1; on level 3 that leaf is above level 2: skip.
    assert build(line(0, 2), [10, 4, 1]).canonical() == root(leaf(1, 0, 1))


def test_a_sample_is_covered_by_the_leaf_that_it_reaches_in_the_end() -> None:
    # When sample 1 is considered only 0 is there; sample 2 becomes a node later and is nearer to it.
    assert build(line(0, 2.5, 4), [3]).canonical() == root(leaf(1, 0), leaf(1, 2, 1))


def test_the_order_of_the_samples_shapes_the_tree() -> None:
    assert len(build(line(0, 2, 4), [3]).root.children) == 2
    assert len(build(line(2, 0, 4), [3]).root.children) == 1


def test_covered_samples_can_be_dropped() -> None:
    assert build(line(0, 2), [3], keep_covered=False).canonical() == root(leaf(1, 0))


def test_no_samples() -> None:
    tree = build(np.zeros((0, 2)), [1])
    assert tree.canonical() == root()
    assert tree.exact([0, 0], 1) == tree.beam([0, 0], 1, 1) == []


@pytest.mark.parametrize("case", examples.adversarial())
def test_batch_construction_keeps_its_promises(case: str) -> None:
    points = examples.adversarial()[case]
    tree = build(points, [8, 4, 2, 1, 0.5])
    assert sorted(tree.filed(tree.root)) == list(range(len(points)))
    assert tree.misfiled() == []
    assert tree.invisible() == []
    for one in [tree.root, *tree.nodes()]:
        children = [points[child.sample] for child in one.children]
        apart = [np.linalg.norm(a - b) for i, a in enumerate(children) for b in children[:i]]
        assert min(apart, default=math.inf) > tree.radii[one.level - len(tree.radii)]
        assert one is tree.root or [child.sample for child in one.children[:1]] in ([], [one.sample])


# --- incremental construction (Appendix A) ----------------------------------------------------------------------------


def test_the_spacing_of_table_a_1() -> None:
    assert spacing(2, 6) == (64, 32, 16, 8, 4, 2)


def inserted(numbers: list[float], radii: list[float] | tuple[float, ...]) -> Tree:
    tree = Tree(radii)
    for number in numbers:
        tree.insert([number])
    return tree


def test_method_i_step_by_step() -> None:
    steps = {
        0.0: root(leaf(1, 0)),
        # Farther than S(1) = 8: a node of level 1.
        20.0: root(leaf(1, 0), leaf(1, 1)),
        # Within S(1) of the leaf 0, farther than S(2) = 4: both at level 2.
        5.0: root(node(1, 0, leaf(2, 0), leaf(2, 2)), leaf(1, 1)),
        # Within S(2) of 5, not farther than S(3) = 2: covered.
        6.0: root(node(1, 0, leaf(2, 0), leaf(2, 2, 3)), leaf(1, 1)),
        # Within S(2) of 5, farther than S(3): both at level 3; what 5 covered stays with it.
        7.5: root(node(1, 0, leaf(2, 0), node(2, 2, leaf(3, 2, 3), leaf(3, 4))), leaf(1, 1)),
        # Nearest are 0, then 0 at level 2, but that is farther than S(2): a third node there.
        -4.5: root(node(1, 0, leaf(2, 0), node(2, 2, leaf(3, 2, 3), leaf(3, 4)), leaf(2, 5)), leaf(1, 1)),
        # At the last level: covered.
        7.0: root(node(1, 0, leaf(2, 0), node(2, 2, leaf(3, 2, 3), leaf(3, 4, 6)), leaf(2, 5)), leaf(1, 1)),
    }
    tree = Tree(spacing(2, 3))
    for number, expected in steps.items():
        tree.insert([number])
        assert tree.canonical() == expected


def test_no_skinny_branches() -> None:
    # Fig A.2: a node is divided one level further at a time, whatever the distance.
    assert inserted([0, 7], spacing(2, 3)).canonical() == root(node(1, 0, leaf(2, 0), leaf(2, 1)))


def test_method_i_goes_on_where_the_batch_ended() -> None:
    tree = build(line(0, 20, 5), spacing(2, 3))
    assert tree.canonical() == inserted([0, 20, 5], spacing(2, 3)).canonical()
    assert tree.insert([7.5]) == 3
    assert tree.canonical() == root(node(1, 0, leaf(2, 0), node(2, 2, leaf(3, 2), leaf(3, 3))), leaf(1, 1))


def test_dropped_samples_keep_their_numbers() -> None:
    tree = Tree([3], keep_covered=False)
    assert [tree.insert([number]) for number in (0.0, 1.0, 9.0)] == [0, 1, 2]
    assert tree.canonical() == root(leaf(1, 0), leaf(1, 2))


# --- answers ----------------------------------------------------------------------------------------------------------


def test_equal_distances_are_decided_for_the_smaller_number() -> None:
    tree = build(line(4, 0, 0, 4), [3])
    assert tree.canonical() == root(leaf(1, 0, 3), leaf(1, 1, 2))
    assert tree.path((2.0,))[-1].sample == 0
    assert tree.exact([2], 3) == [(0, 2), (1, 2), (2, 2)]
    assert tree.beam([2], 3, 2) == tree.exact([2], 3)
    assert tree.beam([2], 3, 1) == [(0, 2), (3, 2)]


def test_answers_at_a_level() -> None:
    tree = build(line(0, 20, 5, 7.5), spacing(2, 3))
    assert [tree.at_level([7], level) for level in (1, 2, 3, 4)] == [0, 2, 3, 3]
    # This branch ends at level 1.
    assert [tree.at_level([19], level) for level in (1, 2, 3)] == [1, 1, 1]


def test_a_leaf_once_reached_stays_among_the_beam() -> None:
    # Level 1: 0 and 20. Below 0: 0, 5 and 7. The query is nearest to 20, second to 7.
    tree = build(line(0, 20, 5, 7), [15, 1])
    assert tree.canonical() == root(node(1, 0, leaf(2, 0), leaf(2, 2), leaf(2, 3)), leaf(1, 1))
    assert [sample for sample, _ in tree.beam([15], 2, 2)] == [1, 3]
    assert tree.beam([15], 2, 1) == [(1, 5)]


def test_a_wide_beam_is_exact() -> None:
    tree = build(examples.adversarial()["scattered"], [8, 4, 2, 1])
    for query in np.random.default_rng(1).normal(size=(10, 2)) * 4:
        assert tree.beam(query, 5, 50) == tree.exact(query, 5)


# --- invisible nodes, repair (Appendix B), removal --------------------------------------------------------------------


def adopted() -> Tree:
    tree = Tree(examples.ADOPTION_RADII)
    for vector in examples.ADOPTION.values():
        tree.insert(vector)
    return tree


B, B_LOW, A, A_LOW, A_COVERED, C = range(6)


def test_a_later_node_makes_others_invisible() -> None:
    tree = adopted()
    lost = node(2, A, leaf(3, A, A_COVERED), leaf(3, A_LOW))
    assert tree.canonical() == root(node(1, B, leaf(2, B), leaf(2, B_LOW), lost), leaf(1, C))
    assert [(one.sample, one.level) for one in tree.invisible()] == [(A, 2), (A, 3), (A_LOW, 3)]
    assert tree.misfiled() == [A, A_LOW, A_COVERED]
    # Samples still there, which a descent misses.
    assert tree.beam(examples.ADOPTION["A"], 1, 1)[0][0] == C
    assert tree.exact(examples.ADOPTION["A"], 1) == [(A, 0)]


def test_repair_gives_them_to_the_node_that_adopted_them() -> None:
    tree = adopted()
    assert tree.repair() == [tree.root]
    found = node(2, A, leaf(3, A, A_COVERED), leaf(3, A_LOW))
    assert tree.canonical() == root(node(1, B, leaf(2, B), leaf(2, B_LOW)), node(1, C, leaf(2, C), found))
    assert tree.canonical() == build(list(examples.ADOPTION.values()), examples.ADOPTION_RADII).canonical()


def test_a_node_below_an_invisible_one_counts_even_if_its_own_vector_reaches_it() -> None:
    # 4 splits into 4 and 2; 8 then captures 6.5 and what is there, but not 4.
    tree = inserted([0, 6.5, 4, 10.5], [9, 3, 1])
    assert tree.canonical() == root(node(1, 0, leaf(2, 0), node(2, 1, leaf(3, 1), leaf(3, 2))), leaf(1, 3))
    assert tree.path((4.0,))[-1].sample == 2
    assert [(one.sample, one.level) for one in tree.invisible()] == [(1, 2), (1, 3), (2, 3)]
    assert tree.path((4.0,))[-1] in tree.invisible()


def test_repair_rebuilds_the_highest_unsound_node_and_nothing_else() -> None:
    # The adoption of Fig B.1 one level down, beside a second cell that is sound.
    tree = Tree([100, *examples.ADOPTION_RADII])
    first, *others = examples.ADOPTION.values()
    for vector in [(1000.0, 0.0), (1005.0, 20.0), first, (0.0, 40.0), *others]:
        tree.insert(vector)
    far, near = tree.root.children
    assert len(tree.invisible()) == 3
    kept = tree.nodes(far)
    assert tree.repair() == [near]
    assert tree.root.children == [far, near]
    assert tree.nodes(far) == kept
    assert tree.misfiled() == []
    assert tree.invisible() == []
    assert tree.repair() == []


def test_what_a_divided_leaf_covered_waits_for_repair() -> None:
    # 5 is covered by 0; then 8 divides the leaf, and 5 is nearer to it.
    tree = inserted([0, 5, 8], [10, 5, 1])
    assert tree.canonical() == root(node(1, 0, leaf(2, 0, 1), leaf(2, 2)))
    assert tree.invisible() == []
    assert tree.misfiled() == [1]
    assert [(one.sample, one.level) for one in tree.repair()] == [(0, 1)]
    assert tree.canonical() == root(node(1, 0, leaf(2, 0), node(2, 2, leaf(3, 2), leaf(3, 1))))


def test_a_removed_sample_is_not_answered_but_shows_the_way_until_repair() -> None:
    tree = build(line(0, 10, 9, 12), [5, 1.5])
    assert tree.canonical() == root(leaf(1, 0), node(1, 1, leaf(2, 1, 2), leaf(2, 3)))
    before = tree.canonical()
    tree.remove(1)
    assert tree.canonical() == before
    assert tree.exact([10], 9) == [(2, 1), (3, 2), (0, 10)]
    assert tree.beam([10], 1, 1) == [(2, 1)]
    tree.remove(2)
    # The leaf that the query reaches is empty.
    assert tree.beam([10], 1, 1) == []
    assert tree.beam([10], 1, 2) == [(3, 2)]
    assert tree.repair() == [tree.root]
    assert tree.canonical() == root(leaf(1, 0), leaf(1, 3))


def test_after_all_samples_are_removed_one_can_begin_again() -> None:
    tree = inserted([0, 7], [5])
    tree.remove(0)
    tree.remove(1)
    tree.repair()
    assert tree.canonical() == root()
    assert tree.insert([3]) == 2
    assert tree.canonical() == root(leaf(1, 2))


@pytest.mark.parametrize("keep_covered", [True, False])
@pytest.mark.parametrize("case", examples.adversarial())
def test_one_pass_of_repair_is_enough(case: str, keep_covered: bool) -> None:
    points = examples.adversarial()[case]
    tree = build(points[::3], [8, 4, 2, 1, 0.5], keep_covered=keep_covered)
    for vector in np.concatenate([points[1::3], points[2::3]]):
        tree.insert(vector.tolist())
    for sample in range(0, len(points), 7):
        tree.remove(sample)
    held = sorted(tree.filed(tree.root))
    tree.repair()
    assert tree.misfiled() == []
    assert tree.invisible() == []
    assert tree.repair() == []
    assert not {one.sample for one in tree.nodes()} & tree.removed
    if keep_covered:
        assert sorted(tree.filed(tree.root)) == held
    else:
        assert set(tree.filed(tree.root)) <= set(held)


def test_random_trees_need_that_repair_on_many_levels() -> None:
    hidden, levels = 0, set()
    for seed in range(20):
        tree = Tree(spacing(2, 4))
        for vector in np.random.default_rng(seed).uniform(0, 40, size=(60, 2)).tolist():
            tree.insert(vector)
        hidden += len(tree.invisible())
        rebuilt = tree.repair()
        levels |= {one.level for one in rebuilt}
        if rebuilt == [tree.root]:
            assert tree.canonical() == build(tree.points, tree.radii).canonical()
        assert tree.misfiled() == []
        assert tree.invisible() == []
    assert hidden > 100
    assert levels >= {0, 1, 2}


def test_a_rebuilt_tree_is_a_new_one() -> None:
    points = examples.adversarial()["scattered"]
    tree = build(points[:20], [8, 4, 2, 1])
    for vector in points[20:].tolist():
        tree.insert(vector)
    assert tree.canonical() != build(points, [8, 4, 2, 1]).canonical()
    tree.rebuild()
    assert tree.canonical() == build(points, [8, 4, 2, 1]).canonical()


def test_canonical_form_of_arrays() -> None:
    # The tree of test_batch_construction, breadth first.
    form = canonical_of([-1, 0, 1, 0, 2], [0, 1, 1, 2, 2], [-1, 0, 0, 1, 1], [(), (), (1, 3), (0,), (2,)])
    assert form == build(line(0, 10, 1, 10.5), [5, 0.8]).canonical()


# --- leaf maps (4.1.2), changelings (Appendix C) ----------------------------------------------------------------------


def test_derived_points() -> None:
    assert derived_points([1, 2], 3).tolist() == [[4, 2], [1, 5], [-2, 2], [1, -1]]


def test_the_leaf_map_of_a_linear_function_is_its_matrix() -> None:
    matrix = np.array([[1.0, -2.0], [0.5, 0.0], [3.0, 4.0]])
    found = leaf_map(lambda inputs: inputs @ matrix.T + 7, [5, -1], 2)
    assert found == pytest.approx(matrix)


def test_the_leaf_map_of_a_bent_function_is_the_chord_over_its_neighbourhood() -> None:
    # (f(1 + R) - f(1 - R)) / 2R of f(x) = x^3.
    assert leaf_map(lambda inputs: inputs**3, [1], 2) == pytest.approx((27 + 1) / 4)


def changeling_trees() -> tuple[Tree, Tree]:
    four, five = Tree(examples.CHANGELING_RADII), Tree(examples.CHANGELING_RADII)
    for vector in examples.CHANGELING_SAMPLES:
        four.insert(vector)
        five.insert(vector)
    five.insert(examples.CHANGELING_NEW)
    return four, five


def error(tree: Tree, query: tuple[float, float]) -> float:
    truth = examples.changeling_teacher(np.array([query]))[0]
    return abs(float((map_query(tree, examples.changeling_teacher, query) - truth)[0]))


def neighbourhood(tree: Tree, query: tuple[float, float]) -> tuple[int, int, bool]:
    """Sample and level of the leaf reached, and whether the query is within the radius that its map was made with."""
    reached = tree.path(query)[-1]
    inside = math.dist(query, tree.points[reached.sample]) <= tree.radii[reached.level - 1]
    return reached.sample, reached.level, inside


@pytest.mark.parametrize(
    ("case", "before", "after", "falls"),
    [
        ("I", (0, 1, True), (4, 2, True), True),
        ("II", (0, 1, True), (4, 2, True), True),
        ("III", (0, 1, False), (4, 2, False), True),
        ("IV", (0, 1, False), (4, 2, False), False),
        ("V", (0, 1, True), (0, 2, False), False),
    ],
)
def test_changelings(case: str, before: tuple[int, int, bool], after: tuple[int, int, bool], falls: bool) -> None:
    four, five = changeling_trees()
    query = examples.CHANGELINGS[case]
    assert neighbourhood(four, query) == before
    assert neighbourhood(five, query) == after
    old, new = error(four, query), error(five, query)
    assert (new < 0.85 * old) if falls else (new > 1.15 * old)


def test_the_changeling_of_case_ii_leaves_a_gap_between_derived_points_for_the_side_of_one() -> None:
    query = np.array(examples.CHANGELINGS["II"])
    four, five = changeling_trees()
    old = derived_points(four.points[0], four.radii[0])
    new = derived_points(five.points[4], five.radii[1])
    assert np.linalg.norm(old - query, axis=1).min() > 0.4 * four.radii[0]
    assert np.linalg.norm(new - query, axis=1).min() < 0.05 * five.radii[1]
