"""The Recursive Partition Tree: batch construction and search (thesis 3.2).

A node at level l holds one sample vector and stands for that vector's Voronoi cell among its siblings, inside its
parent's cell. The root is virtual: it stands for the whole space and holds no vector. A node that splits appears again
as its own first child. Leaves hold the samples that fall into their cell.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handeye.rpt import kernels

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

FAN_OUT = 4
"""How many children a node is to have, on average, when the radii are derived from the data."""

LARGEST = 1e150
"""Larger components would overflow when squared."""


class Tree(NamedTuple):
    """A Recursive Partition Tree of n samples with d components and m nodes, as contiguous arrays.

    Nodes are numbered breadth first; node 0 is the virtual root; the children of a node stand side by side.
    """

    points: Floats
    """(n, d) the input vectors, in the order given; a sample's number is its row."""
    radii: Floats
    """(L,) T(1) > ... > T(L); T(0) is infinite."""
    sample: Integers
    """(m,) the sample whose vector each node holds; -1 for the root."""
    level: Integers
    """(m,) 0 for the root."""
    first_child: Integers
    """(m,) number of the first child; 0 for a leaf."""
    child_count: Integers
    """(m,) 0 for a leaf."""
    cover: Floats
    """(m,) distance from the node's vector to the farthest sample kept below it; infinite for the root."""
    first_member: Integers
    """(m,) where in `members` the samples of a leaf begin."""
    member_count: Integers
    """(m,) how many samples the leaf keeps; 0 for inner nodes."""
    members: Integers
    """The samples kept in leaves, leaf after leaf, ascending within a leaf."""
    waiting: int
    """Most nodes that a depth-first search can have waiting."""


class Neighbours(NamedTuple):
    """Samples near a query, nearest first, equally near ones by ascending number.

    ids and distances have shape (k,) for one query and (q, k) for q queries.
    """

    ids: Integers
    distances: Floats


class Statistics(NamedTuple):
    """What a tree looks like: levels, nodes (without the root), leaves, samples kept, children of the widest node."""

    levels: int
    nodes: int
    leaves: int
    samples: int
    widest: int


def build(inputs: ArrayLike, *, radii: ArrayLike | None = None, keep_covered: bool = True) -> Tree:
    """Builds the tree from all samples at once, level by level, by the rules of Fig 3.18.

    Within level l the samples come in the order given; sample Q descends to leaf X. X above level l - 1: skip. X at
    level l - 1 and D(Q, X) > T(l): X and Q become children of X. X at level l and D(Q, X) > T(l): Q becomes its
    sibling. Otherwise Q is covered by X on this level. The first sample becomes the first node of level 1. Equal
    distances are decided for the smaller sample number.

    Args:
        inputs: (n, d) sample vectors; a (n,) array is taken as n samples with one component.
        radii: T(1) > ... > T(L) >= 0; derived from the data (`derive_radii`) when not given.
        keep_covered: samples that never became a node are kept in the leaf in whose cell they lie. False drops them,
            as the thesis does.

    Raises:
        ValueError: inputs are empty, not finite, of the wrong shape or too large; radii are not a decreasing sequence.
    """
    points = _as_points(inputs)
    chosen = derive_radii(points) if radii is None else _as_radii(radii)
    nodes, sample, parent, level, first_child, next_sibling, home = kernels.grow(points, chosen)
    order, first, count = kernels.arrange(nodes, first_child, next_sibling)
    new_number = np.empty(nodes, np.int64)
    new_number[order] = np.arange(nodes)
    sample, level = sample[order], level[order]
    up = np.zeros(nodes, np.int64)
    up[1:] = new_number[parent[order][1:]]
    home = new_number[home]
    kept = np.arange(len(points)) if keep_covered else np.sort(sample[(count == 0) & (sample >= 0)])
    members = kept[np.argsort(home[kept], kind="stable")]
    member_count = np.bincount(home[kept], minlength=nodes)
    widest = np.zeros(level[-1] + 1, np.int64)
    np.maximum.at(widest, level, count)
    return Tree(
        points=points,
        radii=chosen,
        sample=sample,
        level=level,
        first_child=first,
        child_count=count,
        cover=kernels.covering_radii(points, sample, up, members, home[members]),
        first_member=np.cumsum(member_count) - member_count,
        member_count=member_count,
        members=members,
        waiting=int(widest.sum()) + 1,
    )


def derive_radii(inputs: ArrayLike, *, fan_out: int = FAN_OUT) -> Floats:
    """Radii under which a node has about `fan_out` children, whatever the dimension the samples really fill.

    T(l) is the fan_out^(-l) quantile of the distances between samples: a ball of radius T(l) holds that share of all
    samples, on average, so it takes a small multiple of fan_out balls of one level to cover a ball of the level above.
    L is the smallest number of levels with fan_out^L >= n. The distances are those among 1024 samples, evenly
    spread over the order given. Coincident samples are left out; when all coincide the only radius is 0.

    Raises:
        ValueError: as `build`; fan_out is below 2.
    """
    points = _as_points(inputs)
    if fan_out < 2:
        raise ValueError(f"fan_out must be at least 2, not {fan_out}")
    some = points[np.unique(np.linspace(0, len(points) - 1, min(len(points), 1024)).astype(np.int64))]
    rows = [np.sqrt(((some[i + 1 :] - some[i]) ** 2).sum(axis=1)) for i in range(len(some) - 1)]
    distances = np.concatenate([*rows, np.zeros(0)])
    distances = distances[distances > 0]
    if distances.size == 0:
        return np.zeros(1)
    levels = 1
    while fan_out**levels < len(points):
        levels += 1
    shares = np.power(float(fan_out), -np.arange(1, levels + 1))
    return np.ascontiguousarray(np.unique(np.quantile(distances, shares))[::-1])


def query_beam(tree: Tree, queries: ArrayLike, k: int, width: int | None = None) -> Neighbours:
    """The k near neighbours that a beam search meets (3.2.2).

    On every level the `width` nearest nodes are kept, and only their children looked at on the next. Not always the
    true nearest neighbours (Fig 3.36); `query_exact` finds those.

    Args:
        tree: where to search.
        queries: (d,) one query or (q, d) several.
        k: how many neighbours, at most the number of samples kept in the tree.
        width: of the beam, at least k; k when not given.

    Raises:
        ValueError: k or width is out of range; queries are of the wrong shape or not finite.
    """
    rows, shape = _as_queries(tree, queries, k)
    beam_width = k if width is None else width
    if beam_width < k:
        raise ValueError(f"the beam's width must be at least k = {k}, not {width}")
    ids, distances = np.zeros((len(rows), k), np.int64), np.zeros((len(rows), k))
    kernels.beam_many(tree, rows, beam_width, ids, distances)
    return Neighbours(ids.reshape(shape), distances.reshape(shape))


def query_exact(tree: Tree, queries: ArrayLike, k: int) -> Neighbours:
    """The k nearest samples, by branch and bound on the nodes' covering radii.

    Args:
        tree: where to search.
        queries: (d,) one query or (q, d) several.
        k: how many neighbours, at most the number of samples kept in the tree.

    Raises:
        ValueError: k is out of range; queries are of the wrong shape or not finite.
    """
    rows, shape = _as_queries(tree, queries, k)
    ids, distances = np.zeros((len(rows), k), np.int64), np.zeros((len(rows), k))
    kernels.exact_many(tree, rows, ids, distances)
    return Neighbours(ids.reshape(shape), distances.reshape(shape))


def statistics(tree: Tree) -> Statistics:
    """Counts levels, nodes, leaves, kept samples and the children of the widest node."""
    return Statistics(
        levels=int(tree.level.max()),
        nodes=len(tree.sample) - 1,
        leaves=int((tree.child_count == 0).sum()),
        samples=len(tree.members),
        widest=int(tree.child_count.max()),
    )


def _as_points(inputs: ArrayLike) -> Floats:
    points = np.array(inputs, dtype=np.float64, order="C")
    if points.ndim == 1:
        points = points[:, np.newaxis]
    if points.ndim != 2 or 0 in points.shape:
        raise ValueError(f"inputs must be a non-empty (samples, components) array, not one of shape {points.shape}")
    _check_finite(points, "inputs")
    return points


def _as_radii(radii: ArrayLike) -> Floats:
    chosen = np.array(radii, dtype=np.float64, order="C")
    if chosen.ndim != 1 or chosen.size == 0 or not (chosen[-1] >= 0 and np.all(np.diff(chosen) < 0)):
        raise ValueError(f"radii must be a decreasing sequence T(1) > ... > T(L) >= 0, not {chosen}")
    return chosen


def _as_queries(tree: Tree, queries: ArrayLike, k: int) -> tuple[Floats, tuple[int, ...]]:
    """The queries as rows, and the shape of the answer."""
    if not 1 <= k <= len(tree.members):
        raise ValueError(f"k must be between 1 and the {len(tree.members)} samples in the tree, not {k}")
    rows = np.array(queries, dtype=np.float64, order="C")
    components = tree.points.shape[1]
    if rows.ndim not in (1, 2) or rows.shape[-1] != components:
        raise ValueError(f"a query has {components} components; got an array of shape {rows.shape}")
    _check_finite(rows, "queries")
    return np.atleast_2d(rows), (k,) if rows.ndim == 1 else (len(rows), k)


def _check_finite(values: Floats, name: str) -> None:
    if not np.all(np.abs(values) <= LARGEST):
        raise ValueError(f"{name} must be finite numbers of magnitude up to {LARGEST:g}")
