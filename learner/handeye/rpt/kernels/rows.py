"""Samples side by side in memory: sorting them by child, and the boxes around them."""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def move_rows(rows, ids, order, start, end, spare_rows, spare_ids):
    """Brings rows[start:end] and ids into another order: what stood at order[i] comes to start + i."""
    n = end - start
    for i in range(n):
        at = order[i]
        for t in range(rows.shape[1]):
            spare_rows[i, t] = rows[at, t]
        spare_ids[i] = ids[at]
    for i in range(n):
        for t in range(rows.shape[1]):
            rows[start + i, t] = spare_rows[i, t]
        ids[start + i] = spare_ids[i]


@njit(cache=True, nogil=True)
def corners(rows, start, end, lower, upper):
    """The box of rows[start:end]."""
    for t in range(rows.shape[1]):
        low = np.inf
        high = -np.inf
        for i in range(start, end):
            x = rows[i, t]
            low = x if x < low else low
            high = x if x > high else high
        lower[t] = low
        upper[t] = high


@njit(cache=True, nogil=True)
def deal_out(rows, ids, start, end, nearest, count, order, spare_rows, spare_ids, bounds):
    """Sorts rows[start:end] by child, keeping their order within each; bounds[c]:bounds[c + 1] is child c's part."""
    bounds[: count + 1] = 0
    for i in range(end - start):
        bounds[nearest[i] + 1] += 1
    for c in range(count):
        bounds[c + 1] += bounds[c]
    for i in range(end - start):
        order[bounds[nearest[i]]] = start + i
        bounds[nearest[i]] += 1
    move_rows(rows, ids, order, start, end, spare_rows, spare_ids)
    for c in range(count, 0, -1):
        bounds[c] = bounds[c - 1] + start
    bounds[0] = start
