"""The beam of a beam search: the nodes kept on one level, sorted by (distance, number)."""

import numpy as np
from numba import njit

from handeye.rpt.kernels.lanes import LANES, lowest_bit, point_squares
from handeye.rpt.kernels.layout import BLOCK, CAPACITY, COUNT, ENTRIES
from handeye.rpt.kernels.nearest import comes_after

# Columns: what lies below a node, the sample whose vector it holds, and how far that is (squared).
FAMILY, NUMBER, REACH = range(3)


@njit(cache=True, nogil=True, forceinline=True)
def keep(beams, first, width, count, family, number, square):
    """Puts a node into the beam that begins at row `first`, sorted by (distance, number); returns the beam's length."""
    if count < width:
        place = first + count
        count += 1
    elif comes_after(square, number, beams[first + width - 1, REACH], beams[first + width - 1, NUMBER]):
        return count
    else:
        place = first + width - 1
    while place > first and comes_after(beams[place - 1, REACH], beams[place - 1, NUMBER], square, number):
        beams[place, FAMILY] = beams[place - 1, FAMILY]
        beams[place, NUMBER] = beams[place - 1, NUMBER]
        beams[place, REACH] = beams[place - 1, REACH]
        place -= 1
    beams[place, FAMILY] = family
    beams[place, NUMBER] = number
    beams[place, REACH] = square
    return count


@njit(cache=True, nogil=True)
def keep_children(query, integers, floats, family, limit, beams, first, width, count, out):
    """Offers the children of a node to the beam that begins at row `first`; returns its length."""
    size = integers[family + COUNT]
    vectors = family + ENTRIES + integers[family + CAPACITY]
    d = query.shape[0]
    at = integers[family + BLOCK] + 2 * LANES * d
    for base in range(0, size, LANES):
        worst = beams[first + width - 1, REACH] if count == width else np.inf
        mask = point_squares(floats, at, query, worst, out)
        at += 3 * LANES * d
        if size - base < LANES:
            mask &= (1 << (size - base)) - 1
        while mask:
            lane = lowest_bit(mask)
            mask &= mask - 1
            number = integers[vectors + base + lane]
            if number < limit:
                below = integers[family + ENTRIES + base + lane]
                count = keep(beams, first, width, count, below, number, out[lane])
    return count
