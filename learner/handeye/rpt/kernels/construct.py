"""Batch construction (Fig 3.18), node by node.

The thesis builds level by level, all samples in order on every level. What a node becomes depends only on the samples
in its cell and their order, so one node can be finished after the other, with its samples side by side in memory: the
outcome is the same.
"""

import numpy as np
from numba import njit

from handeye.rpt.kernels.centres import choose_centres, reserve
from handeye.rpt.kernels.lanes import LANES
from handeye.rpt.kernels.layout import (
    COUNT,
    ENTRIES,
    FLAT,
    FLAT_LANES,
    FLOATS_END,
    GROUP_LANES,
    GROUPS,
    HEADER,
    INTEGERS_END,
    NODES,
    PAGE,
    PAGE_LANES,
    ROOT,
    SAMPLES,
    WIDEST,
    add_family,
    floats_needed,
    integers_needed,
    lane_at,
    note_depth,
    put_box,
    put_vector,
    whole_chunks,
)
from handeye.rpt.kernels.rows import corners, deal_out, move_rows

# Columns of a piece of work: which rows, how deep, and the entry that is to name the family made of them.
START, END, LEVEL, VECTOR, PLACE, DEPTH = range(6)
STORAGE = -1  # in place of a level: the rows belong to a leaf and are to be laid into pages


@njit(cache=True, nogil=True)
def select(keys, order, low, high, middle):
    """Sorts keys[low:high], and order along with them, so far that none before `middle` is above one from it on
    (quickselect)."""
    high -= 1
    while low < high:
        first = keys[low]
        pivot = keys[(low + high) // 2]
        last = keys[high]
        pivot = max(min(first, pivot), min(max(first, pivot), last))
        i = low
        j = high
        while i <= j:
            while keys[i] < pivot:
                i += 1
            while keys[j] > pivot:
                j -= 1
            if i <= j:
                keys[i], keys[j] = keys[j], keys[i]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@njit(cache=True, nogil=True)
def widest_component(rows, order, first, last):
    """In which component rows[order[first:last]] extend farthest, and how far."""
    widest = 0
    extent = -1.0
    for t in range(rows.shape[1]):
        low = np.inf
        high = -np.inf
        for i in range(first, last):
            x = rows[order[i], t]
            low = x if x < low else low
            high = x if x > high else high
        if high - low > extent:
            extent = high - low
            widest = t
    return widest, extent


@njit(cache=True, nogil=True)
def halve(rows, ids, start, end, order, keys, spare_rows, spare_ids, bounds):
    """Divides a big leaf's rows into at most GROUP_LANES parts, each time the largest part at the median of its widest
    component, until parts fit on pages. Returns their number; part p is then rows[bounds[p]:bounds[p + 1]]."""
    n = end - start
    for i in range(n):
        order[i] = start + i
    bounds[0] = 0
    bounds[1] = n
    parts = 1
    while parts < GROUP_LANES:
        largest = 0
        for part in range(1, parts):
            if bounds[part + 1] - bounds[part] > bounds[largest + 1] - bounds[largest]:
                largest = part
        first = bounds[largest]
        last = bounds[largest + 1]
        if last - first <= PAGE_LANES:
            break
        # Whole chunks on the left side: no lane of a page stays empty there.
        middle = first + (last - first) // 2 // LANES * LANES
        widest, extent = widest_component(rows, order, first, last)
        if extent > 0:
            for i in range(first, last):
                keys[i] = rows[order[i], widest]
            select(keys, order, first, last, middle)
        for part in range(parts, largest, -1):
            bounds[part + 1] = bounds[part]
        bounds[largest + 1] = middle
        parts += 1
    move_rows(rows, ids, order, start, end, spare_rows, spare_ids)
    for part in range(parts + 1):
        bounds[part] += start
    return parts


@njit(cache=True, nogil=True)
def fill_page(integers, floats, family, rows, ids, start, end, slots):
    """Puts rows[start:end] into an empty page; slots[sample] becomes the place of its entry."""
    for lane in range(end - start):
        put_vector(floats, lane_at(integers, family, lane, rows.shape[1]), rows[start + lane])
        integers[family + ENTRIES + lane] = ids[start + lane]
        slots[ids[start + lane]] = family + ENTRIES + lane
    integers[family + COUNT] = end - start


@njit(cache=True, nogil=True)
def construct(points, order, radii, keep_covered, slots):
    """Builds the tree of points[order]; radii[l - 1] is T(l). Returns the two arenas (see `layout`)."""
    n = order.shape[0]
    d = points.shape[1]
    integers = np.zeros(HEADER + 3 * n // 2 + 1024, np.int64)
    floats = np.empty(n * d * 5 // 4 + 1024 * d)
    integers[INTEGERS_END] = HEADER
    integers[SAMPLES] = points.shape[0]
    # Few large pieces: the system takes them back at once when they are let go.
    memory = np.empty((2 * d + 1) * n)
    rows = memory[: n * d].reshape(n, d)
    spare_rows = memory[n * d : 2 * n * d].reshape(n, d)
    squares = memory[2 * n * d :]
    numbered = np.empty((4, n), np.int64)
    ids, spare_ids, nearest, moves = numbered[0], numbered[1], numbered[2], numbered[3]
    for i in range(n):
        for t in range(d):
            rows[i, t] = points[order[i], t]
        ids[i] = order[i]
    bounds = np.empty(64, np.int64)
    centres = np.empty(LANES * d)
    numbers = np.empty(LANES, np.int64)
    lower = np.empty(d)
    upper = np.empty(d)
    work = np.empty((64, 6), np.int64)
    work[0] = (0, n, 0, -1, ROOT, 0)
    waiting = 1
    while waiting:
        waiting -= 1
        start, end, level, vector, place, depth = work[waiting]
        count = 0
        if level != STORAGE and level < radii.shape[0]:
            centres[: LANES * d] = np.inf
            if vector >= 0:
                put_vector(centres, 0, points[vector])
                numbers[0] = vector
                count = 1
            centres, numbers, count = choose_centres(
                rows, ids, start, end, radii[level], centres, numbers, count, nearest, squares, spare_ids
            )
        if level == 0 or count > 1:
            kind = NODES
            if count >= bounds.shape[0]:
                bounds = np.empty(2 * count, np.int64)
            deal_out(rows, ids, start, end, nearest, count, moves, spare_rows, spare_ids, bounds)
        elif not keep_covered or end - start <= PAGE_LANES:
            if not keep_covered:
                # Only the sample whose vector the leaf holds stays.
                rows[start] = points[vector]
                ids[start] = vector
                end = start + 1
            kind = PAGE
            count = end - start
        else:
            kind = GROUPS
            count = halve(rows, ids, start, end, moves, squares, spare_rows, spare_ids, bounds)
        capacity = whole_chunks(count)
        integers = reserve(integers, integers[INTEGERS_END], integers_needed(kind, capacity))
        floats = reserve(floats, integers[FLOATS_END], floats_needed(kind, capacity, d))
        leaf_level = level if level != STORAGE else vector
        family = add_family(integers, floats, kind, level + 1 if kind == NODES else leaf_level, capacity, d)
        integers[place] = family
        note_depth(integers, level + 1 if kind == NODES else 0, depth)
        if kind == PAGE:
            fill_page(integers, floats, family, rows, ids, start, end, slots)
            continue
        integers[family + COUNT] = count
        if waiting + count > work.shape[0]:
            more = np.empty((2 * (waiting + count), 6), np.int64)
            more[:waiting] = work[:waiting]
            work = more
        for lane in range(count):
            corners(rows, bounds[lane], bounds[lane + 1], lower, upper)
            at = lane_at(integers, family, lane, d)
            put_box(floats, at, lower, upper)
            entry = family + ENTRIES + lane
            if kind == NODES:
                integers[entry + capacity] = numbers[lane]
                put_vector(floats, at + 2 * LANES * d, points[numbers[lane]])
                work[waiting] = (bounds[lane], bounds[lane + 1], level + 1, numbers[lane], entry, 1)
            else:
                # A part of a leaf carries the leaf's level in the vector's column.
                work[waiting] = (bounds[lane], bounds[lane + 1], STORAGE, leaf_level, entry, depth + 1)
            waiting += 1
    if n <= FLAT_LANES and keep_covered:
        integers, floats = add_flat(points, order, integers, floats)
    return integers, floats


@njit(cache=True, nogil=True)
def add_flat(points, order, integers, floats):
    """Adds the page of all samples that the exact search scans while they are few."""
    d = points.shape[1]
    capacity = min(whole_chunks(2 * order.shape[0]), FLAT_LANES)
    integers = reserve(integers, integers[INTEGERS_END], integers_needed(PAGE, capacity))
    floats = reserve(floats, integers[FLOATS_END], floats_needed(PAGE, capacity, d))
    widest = integers[WIDEST]
    family = add_family(integers, floats, PAGE, 0, capacity, d)
    integers[WIDEST] = widest
    for i in range(order.shape[0]):
        put_vector(floats, lane_at(integers, family, i, d), points[order[i]])
        integers[family + ENTRIES + i] = order[i]
    integers[family + COUNT] = order.shape[0]
    integers[FLAT] = family
    return integers, floats
