"""The Recursive Partition Tree as the thesis words it: slow, literal, plain Python objects, nothing of ours in it.

The library's tree is compared with this one node by node. Equal distances are decided for the smaller sample number.
Which of two samples is nearer is decided by squared distances, which order them alike, without the root's rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Vector = tuple[float, ...]

Canonical = tuple[int, int, tuple["Canonical", ...], tuple[int, ...]]
"""(level, sample, children in the order of their making, numbers of the covered samples, ascending).

The root is (0, -1, ...). The sample of a leaf's own vector is not among the covered ones.
"""


def squared(a: Vector, b: Vector) -> float:
    """The square of eq 3.1, summed in the order of the components."""
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total += (x - y) * (x - y)
    return total


def spacing(a: float, levels: int) -> tuple[float, ...]:
    """S(1), ..., S(L) of eq A.1."""
    return tuple(a ** (levels + 1 - level) for level in range(1, levels + 1))


@dataclass(eq=False)
class Node:
    """One node; the root is virtual: level 0, no sample, no parent."""

    sample: int
    level: int
    parent: Node | None = None
    children: list[Node] = field(default_factory=list)
    covered: list[int] = field(default_factory=list)
    """Of a leaf: the samples that ended here without becoming a node."""


class Tree:
    """A tree over samples that are numbered in the order they came, without any to begin with."""

    def __init__(self, radii: Sequence[float], *, keep_covered: bool = True) -> None:
        """T(1) > ... > T(L) are the spacing S(1), ..., S(L) as well."""
        self.radii = [float(radius) for radius in radii]
        self.keep_covered = keep_covered
        self.points: list[Vector] = []
        self.removed: set[int] = set()
        self.root = Node(sample=-1, level=0)

    # --- descent, answers ---------------------------------------------------------------------------------------------

    def nearest(self, nodes: Sequence[Node], vector: Vector) -> Node:
        """The node whose vector is nearest."""
        return min(nodes, key=lambda node: (squared(self.points[node.sample], vector), node.sample))

    def path(self, vector: Vector, top: Node | None = None) -> list[Node]:
        """The nodes that a query passes (3.2.2, k = 1), from `top`, the root if not given, to a leaf."""
        passed = [top or self.root]
        while passed[-1].children:
            passed.append(self.nearest(passed[-1].children, vector))
        return passed

    def at_level(self, query: Sequence[float], level: int) -> int:
        """Eq A.3: the sample that stands for a query at a level, or at the leaf where its branch ends before.

        It may be a removed one, of which only the vector is left.
        """
        return self.path(tuple(query))[: level + 1][-1].sample

    def beam(self, query: Sequence[float], k: int, width: int) -> list[tuple[int, float]]:
        """Near samples and their distances, nearest first (3.2.2); fewer than k if the leaves hold fewer.

        At every level the `width` nearest nodes stay; inner ones give way to their children, leaves stay as they are.
        """
        vector = tuple(query)
        beam = [self.root]
        while any(node.children for node in beam):
            candidates = [child for node in beam for child in (node.children or [node])]
            candidates.sort(key=lambda node: (squared(self.points[node.sample], vector), node.sample))
            beam = candidates[:width]
        return self._closest(vector, [sample for leaf in beam for sample in self.filed(leaf)], k)

    def exact(self, query: Sequence[float], k: int) -> list[tuple[int, float]]:
        """The k nearest of all samples in the tree, by looking at each."""
        return self._closest(tuple(query), self.filed(self.root), k)

    def _closest(self, vector: Vector, samples: Sequence[int], k: int) -> list[tuple[int, float]]:
        order = sorted((squared(self.points[sample], vector), sample) for sample in samples)
        return [(sample, math.sqrt(square)) for square, sample in order[:k]]

    # --- construction -------------------------------------------------------------------------------------------------

    def construct(self, top: Node, samples: Sequence[int]) -> Iterator[tuple[int, int, bool]]:
        """Fig 3.18 below one node, for the levels below it; what was there before is forgotten.

        Yields (level, sample, whether a node was added for it), in the order in which the samples are considered.
        """
        top.children, top.covered = [], []
        for level in range(top.level + 1, len(self.radii) + 1):
            for sample in samples:
                yield level, sample, self._consider(top, sample, level)
        if self.keep_covered:
            for sample in samples:
                self._cover(self.path(self.points[sample], top)[-1], sample)

    def _consider(self, top: Node, sample: int, level: int) -> bool:
        leaf = self.path(self.points[sample], top)[-1]
        if leaf is self.root:
            leaf.children = [Node(sample, level, leaf)]
            return True
        far = self._distance(leaf, sample) > self.radii[level - 1]
        if leaf.level == level - 1 and far:
            leaf.children = [Node(leaf.sample, level, leaf), Node(sample, level, leaf)]
        elif leaf.level == level and far:
            assert leaf.parent is not None
            leaf.parent.children.append(Node(sample, level, leaf.parent))
        else:
            return False
        return True

    def insert(self, vector: Sequence[float]) -> int:
        """Method I (Appendix A): one more sample, visited once; returns its number.

        Where a leaf splits, what it covered stays with the leaf's own vector, in its first child.
        """
        sample = len(self.points)
        self.points.append(tuple(vector))
        node = self.root
        while node.children:
            nearest = self.nearest(node.children, self.points[sample])
            if self._distance(nearest, sample) > self.radii[nearest.level - 1]:
                node.children.append(Node(sample, nearest.level, node))
                return sample
            node = nearest
        level = node.level + 1
        if node is self.root:
            node.children = [Node(sample, level, node)]
        elif level <= len(self.radii) and self._distance(node, sample) > self.radii[level - 1]:
            node.children = [Node(node.sample, level, node, covered=node.covered), Node(sample, level, node)]
            node.covered = []
        elif self.keep_covered:
            self._cover(node, sample)
        return sample

    def _cover(self, leaf: Node, sample: int) -> None:
        if leaf.sample != sample:
            leaf.covered.append(sample)

    def _distance(self, node: Node, sample: int) -> float:
        return math.sqrt(squared(self.points[node.sample], self.points[sample]))

    # --- removal, repair ----------------------------------------------------------------------------------------------

    def remove(self, sample: int) -> None:
        """The sample is not answered any more. A node that holds its vector goes on showing the way until a repair."""
        self.removed.add(sample)

    def filed(self, node: Node) -> list[int]:
        """The samples in the leaves below a node, covered ones too, removed ones not."""
        if node.children:
            return [sample for child in node.children for sample in self.filed(child)]
        here = [node.sample, *node.covered] if node is not self.root else []
        return [sample for sample in here if sample not in self.removed]

    def nodes(self, top: Node | None = None) -> list[Node]:
        """All nodes, or those below `top`; the root is not one of them."""
        below = (top or self.root).children
        return below + [node for child in below for node in self.nodes(child)]

    def invisible(self, top: Node | None = None) -> list[Node]:
        """Appendix B: the nodes that the descent of their own vector does not pass, and all nodes below such.

        A node that split and its own first child hold the same vector; its descent has to pass both.
        """
        found: list[Node] = []
        for child in (top or self.root).children:
            visible = child in self.path(self.points[child.sample])
            found += self.invisible(child) if visible else [child, *self.nodes(child)]
        return found

    def misfiled(self) -> list[int]:
        """The samples whose own descent ends in another leaf than the one that holds them, ascending."""
        leaves = [node for node in self.nodes() if not node.children]
        return sorted(s for leaf in leaves for s in self.filed(leaf) if self.path(self.points[s])[-1] is not leaf)

    def repair(self) -> list[Node]:
        """Rebuilds, from the top down, below every node that is not sound; returns those nodes.

        One pass is enough. Whether a node is sound depends on its children's vectors and on which samples lie below
        which child; rebuilding below a node changes neither for the nodes above and beside it. Below a rebuilt node
        all are sound: batch construction completes one level before the next, and files every sample by its descent.
        And where all nodes are sound, every sample's descent passes the nodes above it, so none is invisible.
        """
        rebuilt, waiting = [], [self.root]
        while waiting:
            node = waiting.pop(0)
            if self._sound(node):
                waiting += node.children
            else:
                rebuilt.append(node)
                for _ in self.construct(node, sorted(self.filed(node))):
                    pass
        return rebuilt

    def _sound(self, node: Node) -> bool:
        """Whether all samples below lie below the nearest child, and no child holds a removed sample's vector."""
        return all(
            child.sample not in self.removed
            and all(self.nearest(node.children, self.points[sample]) is child for sample in self.filed(child))
            for child in node.children
        )

    def rebuild(self) -> None:
        """Batch construction of the whole tree anew, from all samples that have not been removed."""
        for _ in self.construct(self.root, [s for s in range(len(self.points)) if s not in self.removed]):
            pass

    def canonical(self, node: Node | None = None) -> Canonical:
        """The tree, or what is below a node, in a form that can be compared."""
        top = node or self.root
        covered = tuple(sorted(set(top.covered) - self.removed))
        return (top.level, top.sample, tuple(self.canonical(child) for child in top.children), covered)


def steps(points: ArrayLike, radii: Sequence[float]) -> Iterator[tuple[Tree, int, int, bool]]:
    """Batch construction (3.2.3) step by step: the growing tree and what `Tree.construct` yields."""
    tree = Tree(radii)
    tree.points = as_vectors(points)
    for level, sample, added in tree.construct(tree.root, range(len(tree.points))):
        yield tree, level, sample, added


def build(points: ArrayLike, radii: Sequence[float], *, keep_covered: bool = True) -> Tree:
    """Batch construction (3.2.3)."""
    tree = Tree(radii, keep_covered=keep_covered)
    tree.points = as_vectors(points)
    tree.rebuild()
    return tree


def as_vectors(points: ArrayLike) -> list[Vector]:
    """Rows as plain numbers."""
    return [tuple(row) for row in np.asarray(points, dtype=np.float64).tolist()]


def canonical_of(
    sample: Sequence[int], level: Sequence[int], parent: Sequence[int], members: Sequence[Sequence[int]]
) -> Canonical:
    """`Tree.canonical` of a tree given by arrays: node 0 is the root, and children stand in the order of their making.

    Members are the samples that a leaf answers with, that of its own vector among them.
    """
    below: list[list[int]] = [[] for _ in sample]
    for node in range(1, len(sample)):
        below[parent[node]].append(node)

    def form(node: int) -> Canonical:
        covered = tuple(sorted(int(member) for member in members[node] if member != sample[node]))
        return (int(level[node]), int(sample[node]), tuple(form(child) for child in below[node]), covered)

    return form(0)


# --- leaf maps (4.1.2) ------------------------------------------------------------------------------------------------


def derived_points(vector: Sequence[float], radius: float) -> Floats:
    """(2 N, N): at a distance on either side along each axis (Figs 4.2, 4.3)."""
    axes = radius * np.eye(len(vector))
    return np.concatenate([vector + axes, vector - axes])


def leaf_map(teacher: Callable[[Floats], Floats], vector: Sequence[float], radius: float) -> Floats:
    """The (m, n) matrix of eqs 4.1 to 4.4. The teacher knows the outputs (j, m) for inputs (j, n)."""
    derived, primary = derived_points(vector, radius), np.array([vector])
    return np.asarray(np.linalg.lstsq(derived - primary, teacher(derived) - teacher(primary))[0].T)


def map_query(tree: Tree, teacher: Callable[[Floats], Floats], query: Sequence[float]) -> Floats:
    """The output of the leaf that a query reaches: its sample's output and its map, made at its level's radius."""
    leaf = tree.path(tuple(query))[-1]
    primary = tree.points[leaf.sample]
    matrix = leaf_map(teacher, primary, tree.radii[leaf.level - 1])
    return np.asarray(teacher(np.array([primary]))[0] + matrix @ np.subtract(query, primary))
