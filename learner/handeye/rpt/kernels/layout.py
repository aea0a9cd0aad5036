"""How a tree lies in memory: two append-only arenas, one of integers and one of floats.

A *family* is what stands side by side under one parent: the children of a node (NODES), the parts of a big leaf
(GROUPS), or the samples of a small one (PAGE). It is a record in the integer arena,

    kind, level, block, capacity, count, then `capacity` entries and, for NODES, `capacity` vectors,

and a block of chunks (see `lanes`) in the float arena. An entry is a sample number in a PAGE (-1 - number once it is
removed) and the family below a lane otherwise; a vector is the number of the sample that a node holds. A chunk holds
8 d numbers in a PAGE (the samples), 16 d in GROUPS (the boxes' lower and upper corners) and 24 d in NODES (the same,
and then the nodes' vectors).

The arena of integers begins with a header. What readers have once seen stays valid: a writer puts new records behind
the end, makes boxes wider in place, and then publishes with single stores of a count, an entry or a header field.
"""

import numpy as np
from numba import njit

from handeye.rpt.kernels.lanes import LANES

# Fields of the header.
ROOT = 0  # the family of the virtual root: the nodes of level 1
FLAT = 1  # a page of all samples while they are few, else 0; of any capacity up to FLAT_LANES
SAMPLES = 2  # samples with a smaller number are published
INTEGERS_END = 3
FLOATS_END = 4
WAITING = 5  # most families that a depth-first search can have waiting, unless writers come in between
WIDEST = 6  # most lanes of any family
LEVELS = 7  # the deepest level with nodes
STORAGE_DEPTH = 8  # most families of groups and pages, one below the other, in a leaf
HEADER = 16

# Fields of a family.
KIND = 0
LEVEL = 1  # of the nodes; for pages and groups that of the leaf they belong to
BLOCK = 2
CAPACITY = 3
COUNT = 4
ENTRIES = 5

PAGE = 0
GROUPS = 1
NODES = 2

PAGE_LANES = 32
"""Most samples of a page. 64 made searches slower, in 6-D by a twelfth, in 16-D by a fifth; 16 took more memory."""

GROUP_LANES = 16
"""Most parts into which a big leaf is divided at once."""

FLAT_LANES = 512
"""Up to here the exact search scans all samples: faster than any tree."""


@njit(cache=True, nogil=True)
def rows_of(kind):
    """How many vectors a lane of a family has: the sample; two corners; two corners and the node's vector."""
    return 1 if kind == PAGE else (2 if kind == GROUPS else 3)


@njit(cache=True, nogil=True)
def whole_chunks(lanes):
    """Lanes rounded up to full chunks, at least one."""
    return max(LANES, (lanes + LANES - 1) // LANES * LANES)


@njit(cache=True, nogil=True)
def integers_needed(kind, capacity):
    """Size of a family's record."""
    return ENTRIES + capacity * (2 if kind == NODES else 1)


@njit(cache=True, nogil=True)
def floats_needed(kind, capacity, components):
    """Size of a family's block."""
    return rows_of(kind) * capacity * components


@njit(cache=True, nogil=True)
def add_family(integers, floats, kind, level, capacity, components):
    """Appends an empty family; there must be room. Unused lanes lie infinitely far away. Returns its place."""
    family = integers[INTEGERS_END]
    block = integers[FLOATS_END]
    integers[family + KIND] = kind
    integers[family + LEVEL] = level
    integers[family + BLOCK] = block
    integers[family + CAPACITY] = capacity
    integers[family + COUNT] = 0
    size = floats_needed(kind, capacity, components)
    floats[block : block + size] = np.inf
    integers[INTEGERS_END] = family + integers_needed(kind, capacity)
    integers[FLOATS_END] = block + size
    integers[WIDEST] = max(integers[WIDEST], capacity)
    return family


@njit(cache=True, nogil=True)
def lane_at(integers, family, lane, components):
    """Where in the float arena the first component of a lane stands; the next are 8 numbers apart."""
    kind = integers[family + KIND]
    return integers[family + BLOCK] + lane // LANES * (rows_of(kind) * LANES * components) + lane % LANES


@njit(cache=True, nogil=True)
def put_vector(floats, at, vector):
    """Writes a vector into a lane."""
    for t in range(vector.shape[0]):
        floats[at + LANES * t] = vector[t]


@njit(cache=True, nogil=True)
def put_box(floats, at, lower, upper):
    """Writes a box into a lane."""
    put_vector(floats, at, lower)
    put_vector(floats, at + LANES * lower.shape[0], upper)


@njit(cache=True, nogil=True)
def widen_box(floats, at, vector):
    """Makes the box in a lane hold a vector."""
    d = vector.shape[0]
    for t in range(d):
        low = at + LANES * t
        high = low + LANES * d
        floats[low] = min(floats[low], vector[t])
        floats[high] = max(floats[high], vector[t])


@njit(cache=True, nogil=True)
def note_depth(integers, level, storage):
    """Remembers that nodes reach down to a level, or a leaf's storage to a depth, and what a search then needs."""
    integers[LEVELS] = max(integers[LEVELS], level)
    integers[STORAGE_DEPTH] = max(integers[STORAGE_DEPTH], storage)
    integers[WAITING] = (integers[LEVELS] + integers[STORAGE_DEPTH] + 1) * (integers[WIDEST] + 1)
