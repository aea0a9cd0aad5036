"""Which samples of a node's cell become its children, and to which of them the others belong (Fig 3.18)."""

import math

import numpy as np
from numba import njit

from handeye.rpt.kernels.lanes import LANES, nearest_point
from handeye.rpt.kernels.layout import put_vector
from handeye.rpt.kernels.nearest import nearest_of_tied


@njit(cache=True, nogil=True)
def reserve(arena, end, needed):
    """The arena, or a larger copy with room for `needed` more behind `end`."""
    if end + needed <= arena.shape[0]:
        return arena
    larger = np.empty(max(end + needed, arena.shape[0] * 3 // 2), arena.dtype)
    larger[:end] = arena[:end]
    return larger


@njit(cache=True, nogil=True, forceinline=True)
def nearest_centre(centres, count, numbers, query, out):
    """The lane of the nearest of `count` vectors in chunks; its squared distance comes into out[0]. Ties go to the
    smaller number."""
    step = LANES * query.shape[0]
    lane = nearest_point(centres, 0, step, count, query, out)
    return lane if lane >= 0 else nearest_of_tied(query, centres, 0, step, count, numbers, 0, out)


@njit(cache=True, nogil=True)
def choose_until_full(rows, ids, start, end, radius, centres, numbers, count, nearest, squares, seen):
    """`choose_centres` up to the row for which there is no room; returns it and the number of centres."""
    d = rows.shape[1]
    out = np.empty(LANES)
    for i in range(start, end):
        lane = nearest_centre(centres, count, numbers, rows[i], out)
        square = out[0]
        if count == 0 or math.sqrt(square) > radius:
            if count == numbers.shape[0]:
                return i, count
            put_vector(centres, count // LANES * LANES * d + count % LANES, rows[i])
            numbers[count] = ids[i]
            lane = count
            square = 0.0
            count += 1
        nearest[i - start] = lane
        squares[i - start] = square
        seen[i - start] = count
    return end, count


@njit(cache=True, nogil=True)
def compare_with_later(rows, start, end, centres, numbers, count, nearest, squares, seen):
    """Gives rows to children that were made after these rows had been looked at."""
    d = rows.shape[1]
    out = np.empty(LANES)
    for i in range(end - start):
        first = seen[i] // LANES * LANES
        if seen[i] == count:
            continue
        lane = first + nearest_point(centres, first * d, LANES * d, count - first, rows[start + i], out)
        if lane < first:
            nearest[i] = nearest_of_tied(rows[start + i], centres, 0, LANES * d, count, numbers, 0, out)
        elif out[0] < squares[i] or (out[0] == squares[i] and numbers[lane] < numbers[nearest[i]]):
            nearest[i] = lane


@njit(cache=True, nogil=True)
def choose_centres(rows, ids, start, end, radius, centres, numbers, count, nearest, squares, seen):
    """One level of one node: which of its samples become children, and to which child each sample belongs.

    `count` vectors are there already (1: the node's own; 0: the root has none). A sample farther than `radius` from all
    becomes one more. Returns (centres, numbers, count); nearest[i] is the child of row start + i.
    """
    d = rows.shape[1]
    done = start
    while done < end:
        begin = done - start
        done, count = choose_until_full(
            rows, ids, done, end, radius, centres, numbers, count, nearest[begin:], squares[begin:], seen[begin:]
        )
        if done < end:
            centres = reserve(centres, centres.shape[0], centres.shape[0])
            numbers = reserve(numbers, count, count)
            centres[count * d :] = np.inf
    compare_with_later(rows, start, end, centres, numbers, count, nearest, squares, seen)
    return centres, numbers, count
