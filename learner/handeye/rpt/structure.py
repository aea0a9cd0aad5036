"""What a tree looks like from outside: its nodes, and figures about them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handeye.rpt.kernels.layout import BLOCK, CAPACITY, COUNT, ENTRIES, KIND, NODES, PAGE, ROOT

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Nodes(NamedTuple):
    """The nodes of a tree, breadth first; node 0 is the virtual root; children stand in the order of their making."""

    sample: Integers
    """(m,) the sample whose vector each node holds; -1 for the root."""
    level: Integers
    """(m,) 0 for the root."""
    parent: Integers
    """(m,) number of the node above; -1 for the root."""
    child_count: Integers
    """(m,) 0 for a leaf."""
    members: tuple[tuple[int, ...], ...]
    """The samples that each leaf keeps, ascending; empty for other nodes."""


class Statistics(NamedTuple):
    """What a tree looks like in figures (3.4, Appendix B)."""

    levels: int
    nodes: int
    """Without the root."""
    leaves: int
    samples: int
    """That can be answered."""
    widest: int
    """Children of the widest node."""
    fan_out: float
    """Children of a node that has any, on average."""
    kappa: tuple[float, ...]
    """For each level the bound (2 max V / r)^N of 3.4 on the children of one node, V being the diameters of the cells
    above (here of the boxes around their samples) and r = T(l); infinite where r = 0."""
    invisible: int
    """Nodes that no query can reach any more, with all below them (Appendix B); `Tree.repair` makes it 0."""
    bytes: int
    """Memory of the samples and the tree."""


def list_nodes(integers: Integers) -> Nodes:
    """Reads the nodes out of the arena."""
    sample, level, parent, child_count = [-1], [0], [-1], [0]
    members: list[tuple[int, ...]] = [()]
    families = [int(integers[ROOT])]
    node = 0
    while node < len(families):
        family = families[node]
        if integers[family + KIND] == NODES:
            count, capacity = int(integers[family + COUNT]), int(integers[family + CAPACITY])
            first = family + ENTRIES
            child_count[node] = count
            sample += integers[first + capacity : first + capacity + count].tolist()
            level += [level[node] + 1] * count
            parent += [node] * count
            child_count += [0] * count
            members += [()] * count
            families += integers[first : first + count].tolist()
        else:
            members[node] = tuple(sorted(_stored(integers, family)))
        node += 1
    return Nodes(
        np.array(sample, np.int64),
        np.array(level, np.int64),
        np.array(parent, np.int64),
        np.array(child_count, np.int64),
        tuple(members),
    )


def _stored(integers: Integers, family: int) -> list[int]:
    """The samples in a leaf's pages. Groups of many equal samples lie deeper in each other than Python recurses."""
    found: list[int] = []
    waiting = [family]
    while waiting:
        here = waiting.pop()
        entries = integers[here + ENTRIES : here + ENTRIES + integers[here + COUNT]].tolist()
        if integers[here + KIND] == PAGE:
            found += [entry for entry in entries if entry >= 0]
        else:
            waiting += entries
    return found


def widest_cells(integers: Integers, floats: Floats, components: int) -> list[float]:
    """For each level with children, root first, the longest diagonal of the boxes of its nodes."""
    found: list[float] = []
    families = [int(integers[ROOT])]
    while families:
        boxes = [box for family in families for box in _boxes(integers, floats, family, components)]
        found.append(max((float(np.linalg.norm(upper - lower)) for lower, upper, _ in boxes), default=0.0))
        families = [below for _, _, below in boxes if integers[below + KIND] == NODES]
    return found


def _boxes(integers: Integers, floats: Floats, family: int, components: int) -> list[tuple[Floats, Floats, int]]:
    """Lower corner, upper corner and entry of each lane of a NODES family."""
    count, capacity = int(integers[family + COUNT]), int(integers[family + CAPACITY])
    start = int(integers[family + BLOCK])
    block = floats[start : start + 3 * capacity * components].reshape(-1, 3, components, 8)
    lower, upper = (block[:, row].transpose(0, 2, 1).reshape(-1, components)[:count] for row in (0, 1))
    entries = integers[family + ENTRIES : family + ENTRIES + count].tolist()
    return list(zip(lower, upper, entries, strict=True))
