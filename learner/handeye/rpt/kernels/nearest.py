"""Choosing among what stands side by side: the nearest node, the nearest part of a leaf."""

import numpy as np
from numba import njit

from handeye.rpt.kernels.lanes import LANES, nearest_box, nearest_point, point_squares
from handeye.rpt.kernels.layout import BLOCK, CAPACITY, COUNT, ENTRIES


@njit(cache=True, nogil=True, forceinline=True)
def comes_after(square_a, number_a, square_b, number_b):
    """Whether a is farther than b; at equal distance, whether its number is larger."""
    return (square_a > square_b) | ((square_a == square_b) & (number_a > number_b))


@njit(cache=True, nogil=True)
def nearest_of_tied(query, block, at, step, count, numbers, first, out):
    """The lane of the nearest of `count` vectors, some of them equally near: that with the smaller number.

    Their chunks begin at `at` and are `step` apart; numbers[first] belongs to lane 0. The squared distance comes into
    out[0].
    """
    best = 0
    best_square = np.inf
    for base in range(0, count, LANES):
        point_squares(block, at, query, np.inf, out)
        at += step
        for lane in range(base, min(base + LANES, count)):
            if comes_after(best_square, numbers[first + best], out[lane - base], numbers[first + lane]):
                best = lane
                best_square = out[lane - base]
    out[0] = best_square
    return best


@njit(cache=True, nogil=True)
def nearest_lane(query, integers, floats, family, limit, out):
    """The lane of a NODES family whose vector is nearest, and its squared distance; ties go to the smaller number.

    The lane is -1 when there is none in the snapshot.
    """
    vectors = family + ENTRIES + integers[family + CAPACITY]
    # Later nodes stand behind those of the snapshot.
    size = integers[family + COUNT]
    while size > 0 and integers[vectors + size - 1] >= limit:
        size -= 1
    if size == 0:
        return -1, np.inf
    step = 3 * LANES * query.shape[0]
    at = integers[family + BLOCK] + 2 * LANES * query.shape[0]
    lane = nearest_point(floats, at, step, size, query, out)
    if lane < 0:
        lane = nearest_of_tied(query, floats, at, step, size, integers, vectors, out)
    return lane, out[0]


@njit(cache=True, nogil=True)
def nearest_group(query, integers, floats, family, out):
    """A lane of a GROUPS family whose box is nearest."""
    step = 2 * LANES * query.shape[0]
    lane = nearest_box(floats, integers[family + BLOCK], step, integers[family + COUNT], query, out)
    return lane if lane >= 0 else -1 - lane
