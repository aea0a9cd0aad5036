"""Pages that grow and divide as samples are inserted. Nothing here is visible to readers before it is published.

A page or group that must be divided is replaced by new ones; the old one stays as it is for those who are reading it.
"""

import numpy as np
from numba import njit

from handeye.rpt.kernels.lanes import LANES
from handeye.rpt.kernels.layout import (
    BLOCK,
    CAPACITY,
    COUNT,
    ENTRIES,
    FLAT,
    FLAT_LANES,
    GROUP_LANES,
    GROUPS,
    KIND,
    LEVEL,
    NODES,
    PAGE,
    PAGE_LANES,
    WIDEST,
    add_family,
    lane_at,
    note_depth,
    put_box,
    put_vector,
    rows_of,
    whole_chunks,
    widen_box,
)
from handeye.rpt.kernels.nearest import nearest_group


@njit(cache=True, nogil=True)
def store(stores, count, place, number):
    """Notes a store for `publish`; returns how many there are."""
    stores[count, 0] = place
    stores[count, 1] = number
    return count + 1


@njit(cache=True, nogil=True)
def copy_family(integers, floats, family, capacity, components):
    """A copy of a family with room for more lanes."""
    kind = integers[family + KIND]
    copy = add_family(integers, floats, kind, integers[family + LEVEL], capacity, components)
    old_capacity = integers[family + CAPACITY]
    count = integers[family + COUNT]
    for lane in range(count):
        integers[copy + ENTRIES + lane] = integers[family + ENTRIES + lane]
        if kind == NODES:
            integers[copy + ENTRIES + capacity + lane] = integers[family + ENTRIES + old_capacity + lane]
    size = rows_of(kind) * whole_chunks(count) * components
    source = integers[family + BLOCK]
    target = integers[copy + BLOCK]
    floats[target : target + size] = floats[source : source + size]
    integers[copy + COUNT] = count
    return copy


@njit(cache=True, nogil=True)
def page_box(floats, integers, page, components, lower, upper):
    """The box of a page's samples."""
    lower[:] = np.inf
    upper[:] = -np.inf
    for lane in range(integers[page + COUNT]):
        at = lane_at(integers, page, lane, components)
        for t in range(components):
            lower[t] = min(lower[t], floats[at + LANES * t])
            upper[t] = max(upper[t], floats[at + LANES * t])


@njit(cache=True, nogil=True)
def divide_page(integers, floats, points, page, sample, slots):
    """Two new pages for a full one and one more sample. Removed samples are left behind."""
    d = points.shape[1]
    size = integers[page + COUNT]
    ids = np.empty(size + 1, np.int64)
    held = 0
    for lane in range(size):
        if integers[page + ENTRIES + lane] >= 0:
            ids[held] = integers[page + ENTRIES + lane]
            held += 1
    ids[held] = sample
    held += 1
    widest = 0
    extent = -1.0
    for t in range(d):
        lower = np.inf
        upper = -np.inf
        for i in range(held):
            lower = min(lower, points[ids[i], t])
            upper = max(upper, points[ids[i], t])
        if upper - lower > extent:
            extent = upper - lower
            widest = t
    keys = np.empty(held)
    for i in range(held):
        keys[i] = points[ids[i], widest]
    order = np.argsort(keys)
    level = integers[page + LEVEL]
    middle = (held + 1) // 2
    left = add_family(integers, floats, PAGE, level, PAGE_LANES, d)
    right = add_family(integers, floats, PAGE, level, PAGE_LANES, d)
    for i in range(held):
        half = left if i < middle else right
        lane = integers[half + COUNT]
        number = ids[order[i]]
        put_vector(floats, lane_at(integers, half, lane, d), points[number])
        integers[half + ENTRIES + lane] = number
        slots[number] = half + ENTRIES + lane
        integers[half + COUNT] = lane + 1
    return left, right


@njit(cache=True, nogil=True)
def add_covered(integers, floats, points, leaf, place, sample, slots, stores, count, out):
    """Puts a covered sample into a leaf's storage; `place` is the entry that names the leaf."""
    d = points.shape[1]
    vector = points[sample]
    family = leaf
    above = -1  # the GROUPS family that `place` belongs to, and the entry that names it
    above_place = -1
    above_lane = -1
    depth = 1
    while integers[family + KIND] == GROUPS:
        lane = nearest_group(vector, integers, floats, family, out)
        widen_box(floats, lane_at(integers, family, lane, d), vector)
        above = family
        above_place = place
        above_lane = lane
        place = family + ENTRIES + lane
        family = integers[place]
        depth += 1
    size = integers[family + COUNT]
    if size < integers[family + CAPACITY]:
        put_vector(floats, lane_at(integers, family, size, d), vector)
        integers[family + ENTRIES + size] = sample
        slots[sample] = family + ENTRIES + size
        return store(stores, count, family + COUNT, size + 1)
    if size < PAGE_LANES:
        copy = copy_family(integers, floats, family, min(2 * size, PAGE_LANES), d)
        put_vector(floats, lane_at(integers, copy, size, d), vector)
        integers[copy + ENTRIES + size] = sample
        for lane in range(size + 1):
            number = integers[copy + ENTRIES + lane]
            slots[number if number >= 0 else -1 - number] = copy + ENTRIES + lane
        integers[copy + COUNT] = size + 1
        return store(stores, count, place, copy)
    left, right = divide_page(integers, floats, points, family, sample, slots)
    if above >= 0 and integers[above + COUNT] < GROUP_LANES:
        groups = copy_family(integers, floats, above, whole_chunks(integers[above + COUNT] + 1), d)
        left_lane = above_lane
        right_lane = integers[groups + COUNT]
        place = above_place
    else:
        groups = add_family(integers, floats, GROUPS, integers[family + LEVEL], LANES, d)
        left_lane = 0
        right_lane = 1
        note_depth(integers, 0, depth + 1)
    lower = np.empty(d)
    upper = np.empty(d)
    page_box(floats, integers, left, d, lower, upper)
    put_box(floats, lane_at(integers, groups, left_lane, d), lower, upper)
    page_box(floats, integers, right, d, lower, upper)
    put_box(floats, lane_at(integers, groups, right_lane, d), lower, upper)
    integers[groups + ENTRIES + left_lane] = left
    integers[groups + ENTRIES + right_lane] = right
    integers[groups + COUNT] = right_lane + 1
    return store(stores, count, place, groups)


@njit(cache=True, nogil=True)
def add_to_flat(integers, floats, vector, sample, stores, count):
    """Puts a sample into the page of all samples, or gives that page up when there are too many."""
    d = vector.shape[0]
    flat = integers[FLAT]
    size = integers[flat + COUNT]
    if size == FLAT_LANES:
        return store(stores, count, FLAT, 0)
    page = flat
    if size == integers[flat + CAPACITY]:
        widest = integers[WIDEST]
        page = copy_family(integers, floats, flat, min(2 * size, FLAT_LANES), d)
        integers[WIDEST] = widest
    put_vector(floats, lane_at(integers, page, size, d), vector)
    integers[page + ENTRIES + size] = sample
    if page == flat:
        return store(stores, count, flat + COUNT, size + 1)
    integers[page + COUNT] = size + 1
    return store(stores, count, FLAT, page)
