"""Search: exact by branch and bound on boxes, and the thesis's beam (3.2.2).

The samples found so far stand in `ids` and `squares`, k of each, sorted by (distance, number); places that are not
taken hold -1 and infinity. A *stack* holds families still to be searched and the squared distances of their boxes.
"""

import numpy as np
from numba import njit

from handeye.rpt.kernels.beams import NUMBER, REACH, keep, keep_children
from handeye.rpt.kernels.lanes import LANES, box_squares, lowest_bit, point_squares, prefetch
from handeye.rpt.kernels.layout import BLOCK, CAPACITY, COUNT, ENTRIES, FLAT, KIND, NODES, PAGE, ROOT, WAITING
from handeye.rpt.kernels.nearest import comes_after, nearest_group, nearest_lane

# Columns of a stack; there may be more.
FAMILY, BOUND = 0, 1

BRANCH_FREE = 16
"""Up to so many neighbours, a new one passes through the whole list: moves cost less than branches guessed wrongly."""


@njit(cache=True, nogil=True, forceinline=True)
def clear(ids, squares):
    """Empties a list of the nearest."""
    for place in range(ids.shape[0]):
        ids[place] = -1
        squares[place] = np.inf


@njit(cache=True, nogil=True, forceinline=True)
def insert_sorted(ids, squares, square, sample):
    """Puts a sample into the list of the nearest if it belongs there."""
    k = ids.shape[0]
    if k <= BRANCH_FREE:
        for place in range(k):
            other = squares[place]
            number = ids[place]
            moves = comes_after(other, number, square, sample)
            squares[place] = square if moves else other
            ids[place] = sample if moves else number
            square = other if moves else square
            sample = number if moves else sample
    elif comes_after(squares[k - 1], ids[k - 1], square, sample):
        place = k - 1
        while place > 0 and comes_after(squares[place - 1], ids[place - 1], square, sample):
            squares[place] = squares[place - 1]
            ids[place] = ids[place - 1]
            place -= 1
        squares[place] = square
        ids[place] = sample


@njit(cache=True, nogil=True)
def offer(ids, squares, count, square, sample):
    """`insert_sorted` into a list that holds `count` samples so far; returns how many it holds then."""
    if count == 0:
        clear(ids, squares)
    insert_sorted(ids, squares, square, sample)
    return min(count + 1, ids.shape[0])


@njit(cache=True, nogil=True)
def held(squares):
    """How many samples a list holds."""
    count = squares.shape[0]
    while count > 0 and squares[count - 1] == np.inf:
        count -= 1
    return count


@njit(cache=True, nogil=True, forceinline=True)
def scan_page(query, integers, floats, page, limit, ids, squares, out):
    """Offers the samples of a page to the list of the nearest."""
    last = ids.shape[0] - 1
    size = integers[page + COUNT]
    at = integers[page + BLOCK]
    for base in range(0, size, LANES):
        mask = point_squares(floats, at, query, squares[last], out)
        at += LANES * query.shape[0]
        if size - base < LANES:
            mask &= (1 << (size - base)) - 1
        while mask:
            lane = lowest_bit(mask)
            mask &= mask - 1
            sample = integers[page + ENTRIES + base + lane]
            # Removed samples are negative; later ones belong to a later snapshot.
            if 0 <= sample < limit:
                insert_sorted(ids, squares, out[lane], sample)


@njit(cache=True, nogil=True, forceinline=True)
def push(stack, top, family, square):
    """Pushes a family; returns the stack's new height."""
    stack[top, FAMILY] = family
    stack[top, BOUND] = square
    return top + 1


@njit(cache=True, nogil=True, forceinline=True)
def push_boxes(query, integers, floats, family, size, worst, stack, top, out):
    """Pushes those of the first `size` lanes whose box is not farther than `worst`, the nearest last; returns the
    stack's new height."""
    at = integers[family + BLOCK]
    step = (3 if integers[family + KIND] == NODES else 2) * LANES * query.shape[0]
    bottom = top
    for base in range(0, size, LANES):
        mask = box_squares(floats, at, query, worst, out)
        at += step
        if size - base < LANES:
            mask &= (1 << (size - base)) - 1
        while mask:
            lane = lowest_bit(mask)
            mask &= mask - 1
            below = integers[family + ENTRIES + base + lane]
            prefetch(integers, below)
            if top > bottom and stack[top - 1, BOUND] < out[lane]:
                stack[top, FAMILY] = stack[top - 1, FAMILY]
                stack[top, BOUND] = stack[top - 1, BOUND]
                push(stack, top - 1, below, out[lane])
                top += 1
            else:
                top = push(stack, top, below, out[lane])
    return top


@njit(cache=True, nogil=True, forceinline=True)
def prefetch_next(integers, floats, stack, top):
    """Has the first chunk of the block that is next on the stack brought near, whatever it is."""
    if top > 0:
        at = integers[int(stack[top - 1, FAMILY]) + BLOCK]
        for line in range(4):
            prefetch(floats, at + LANES * line)


@njit(cache=True, nogil=True, forceinline=True)
def descend(query, integers, floats, limit, scanned, ids, squares, stack, top, out):
    """Branch and bound over the families on the stack, without the page `scanned`.

    False when the stack is too short, as it may be when a writer has made families wider since it was allocated.
    """
    last = ids.shape[0] - 1
    while top > 0:
        top -= 1
        if stack[top, BOUND] > squares[last]:
            continue
        family = int(stack[top, FAMILY])
        if integers[family + KIND] == PAGE:
            prefetch_next(integers, floats, stack, top)
            if family != scanned:
                scan_page(query, integers, floats, family, limit, ids, squares, out)
            continue
        # Read once: a writer may make it larger at any time.
        size = integers[family + COUNT]
        if top + size > stack.shape[0]:
            return False
        top = push_boxes(query, integers, floats, family, size, squares[last], stack, top, out)
    return True


@njit(cache=True, nogil=True)
def exact(query, integers, floats, limit, ids, squares, stack, out):
    """Fills ids and squares with the nearest samples and their squared distances; returns how many there are.

    The page to which the nearest vectors lead is scanned first. Its samples give a bound that leaves out most of the
    tree.
    """
    clear(ids, squares)
    family = integers[FLAT]
    if family:
        scan_page(query, integers, floats, family, limit, ids, squares, out)
        return held(squares)
    family = integers[ROOT]
    while integers[family + KIND] != PAGE:
        if integers[family + KIND] == NODES:
            lane, _ = nearest_lane(query, integers, floats, family, limit, out)
        else:
            lane = nearest_group(query, integers, floats, family, out)
        if lane < 0:
            return 0
        family = integers[family + ENTRIES + lane]
    scan_page(query, integers, floats, family, limit, ids, squares, out)
    top = push(stack, 0, integers[ROOT], 0.0)
    if not descend(query, integers, floats, limit, family, ids, squares, stack, top, out) or twice(ids):
        exact_again(query, integers, floats, limit, ids, squares, stack.shape[0], out)
    return held(squares)


@njit(cache=True, nogil=True, forceinline=True)
def twice(ids):
    """Whether a sample was found twice: a writer has put another page in the place of that which was scanned first."""
    found = False
    for place in range(1, ids.shape[0]):
        found |= (ids[place] == ids[place - 1]) & (ids[place] >= 0)
    return found


@njit(cache=True, nogil=True)
def exact_again(query, integers, floats, limit, ids, squares, height, out):
    """`exact` where a writer came in between: it meets every sample once, and takes the room that it needs."""
    done = False
    while not done:
        clear(ids, squares)
        height *= 2
        stack = np.empty((height, 2))
        top = push(stack, 0, integers[ROOT], 0.0)
        done = descend(query, integers, floats, limit, -1, ids, squares, stack, top, out)


@njit(cache=True, nogil=True)
def beam(query, integers, floats, limit, width, ids, squares, stack, out):
    """Fills ids and squares with the nearest samples that a beam search meets (3.2.2); returns how many there are and
    with how many nodes the query was compared.

    On every level the `width` nearest nodes are kept and only their children looked at; a leaf, once reached, goes on
    competing with them.
    """
    # Two beams, this level's and the next, take turns.
    beams = np.empty((2 * width, 3))
    this = 0
    beams[0, FAMILY] = integers[ROOT]
    beams[0, NUMBER] = -1
    beams[0, REACH] = 0.0
    count = 1
    looked = 0
    descending = True
    while descending:
        descending = False
        kept = 0
        for i in range(this, this + count):
            family = int(beams[i, FAMILY])
            if integers[family + KIND] == NODES:
                descending = True
                looked += integers[family + COUNT]
                kept = keep_children(query, integers, floats, family, limit, beams, width - this, width, kept, out)
            else:
                kept = keep(beams, width - this, width, kept, family, beams[i, NUMBER], beams[i, REACH])
        this = width - this
        count = kept
    height = stack.shape[0]
    done = count <= height and search_leaves(
        query, integers, floats, limit, beams, this, count, ids, squares, stack, out
    )
    while not done:
        height = 2 * height + count
        taller = np.empty((height, 2))
        done = search_leaves(query, integers, floats, limit, beams, this, count, ids, squares, taller, out)
    return held(squares), looked


@njit(cache=True, nogil=True)
def search_leaves(query, integers, floats, limit, beams, first, count, ids, squares, stack, out):
    """Fills ids and squares from the leaves that a beam holds; False as for `descend`."""
    clear(ids, squares)
    top = 0
    for i in range(first + count - 1, first - 1, -1):
        top = push(stack, top, beams[i, FAMILY], 0.0)
    return descend(query, integers, floats, limit, -1, ids, squares, stack, top, out)


@njit(cache=True, nogil=True)
def vector_at_level(query, integers, floats, limit, level, out):
    """The sample whose vector stands for the query at a level: the leaf's when the branch ends before (eq A.3)."""
    family = integers[ROOT]
    number = -1
    for _ in range(level):
        if integers[family + KIND] != NODES:
            break
        lane, _ = nearest_lane(query, integers, floats, family, limit, out)
        number = integers[family + ENTRIES + integers[family + CAPACITY] + lane]
        family = integers[family + ENTRIES + lane]
    return number


@njit(cache=True, nogil=True)
def exact_many(queries, integers, floats, limit, ids, squares):
    """`exact` for every row of queries."""
    stack = np.empty((integers[WAITING], 2))
    out = np.empty(LANES)
    for i in range(queries.shape[0]):
        exact(queries[i], integers, floats, limit, ids[i], squares[i], stack, out)


@njit(cache=True, nogil=True)
def beam_many(queries, integers, floats, limit, width, ids, squares):
    """`beam` for every row of queries; returns with how many nodes each was compared."""
    stack = np.empty((integers[WAITING] + width, 2))
    out = np.empty(LANES)
    looked = np.empty(queries.shape[0], np.int64)
    for i in range(queries.shape[0]):
        _, looked[i] = beam(queries[i], integers, floats, limit, width, ids[i], squares[i], stack, out)
    return looked


@njit(cache=True, nogil=True)
def vectors_at_level(queries, integers, floats, limit, level):
    """`vector_at_level` for every row of queries."""
    out = np.empty(LANES)
    numbers = np.empty(queries.shape[0], np.int64)
    for i in range(queries.shape[0]):
        numbers[i] = vector_at_level(queries[i], integers, floats, limit, level, out)
    return numbers


@njit(cache=True, nogil=True)
def all_within(values, most):
    """Whether all values are numbers of magnitude up to `most`."""
    within = True
    for x in values:
        within &= abs(x) <= most
    return within
