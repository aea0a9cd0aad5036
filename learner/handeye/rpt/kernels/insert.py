"""Incremental construction, Method I (Appendix A), beside readers.

`prepare` writes everything new behind the ends of the arenas and into lanes that no count covers yet; the only thing it
changes in place are boxes, which become wider. `publish` then makes it visible by single stores, in order. They are
two calls so that no compiler moves a store from one into the other.
"""

import math

import numpy as np
from numba import njit

from handeye.rpt.kernels.growth import add_covered, add_to_flat, copy_family, store
from handeye.rpt.kernels.lanes import LANES
from handeye.rpt.kernels.layout import (
    CAPACITY,
    COUNT,
    ENTRIES,
    FLAT,
    FLOATS_END,
    GROUP_LANES,
    INTEGERS_END,
    KIND,
    LEVEL,
    NODES,
    PAGE,
    PAGE_LANES,
    ROOT,
    SAMPLES,
    add_family,
    floats_needed,
    integers_needed,
    lane_at,
    note_depth,
    put_box,
    put_vector,
    widen_box,
)
from handeye.rpt.kernels.nearest import nearest_lane

# Outcomes of `prepare`.
PREPARED = 0
COVERED = 1  # dropped: the tree keeps no covered samples
NO_ROOM = 2  # an arena must grow first

MOST_STORES = 8
MOST_SAMPLES = np.iinfo(np.int64).max


@njit(cache=True, nogil=True)
def has_room(integers, floats, family, components):
    """Whether the arenas have room for all that a sample may take which comes into or below a NODES family."""
    lanes = 3 * PAGE_LANES + 2 * GROUP_LANES + 4 * LANES
    if integers[family + COUNT] == integers[family + CAPACITY]:
        lanes += 2 * integers[family + CAPACITY]
    flat = integers[FLAT]
    if flat and integers[flat + COUNT] == integers[flat + CAPACITY]:
        lanes += 2 * integers[flat + CAPACITY]
    # NODES have the most numbers for each lane; no more than eight families are made.
    return (
        integers[INTEGERS_END] + integers_needed(NODES, lanes) + 8 * ENTRIES <= integers.shape[0]
        and integers[FLOATS_END] + floats_needed(NODES, lanes, components) <= floats.shape[0]
    )


@njit(cache=True, nogil=True)
def publish(integers, stores, count):
    """Makes visible what `prepare` has written."""
    for i in range(count):
        integers[stores[i, 0]] = stores[i, 1]


@njit(cache=True, nogil=True)
def new_page(integers, floats, level, sample, vector, slots):
    """A page with one sample."""
    page = add_family(integers, floats, PAGE, level, LANES, vector.shape[0])
    put_vector(floats, lane_at(integers, page, 0, vector.shape[0]), vector)
    integers[page + ENTRIES] = sample
    integers[page + COUNT] = 1
    slots[sample] = page + ENTRIES
    return page


@njit(cache=True, nogil=True)
def fill_node(integers, floats, family, lane, below, sample, lower, upper, vector):
    """Writes one lane of a NODES family; no count covers it yet."""
    at = lane_at(integers, family, lane, vector.shape[0])
    put_box(floats, at, lower, upper)
    put_vector(floats, at + 2 * LANES * vector.shape[0], vector)
    integers[family + ENTRIES + integers[family + CAPACITY] + lane] = sample
    integers[family + ENTRIES + lane] = below


@njit(cache=True, nogil=True)
def add_node(integers, floats, family, place, page, sample, vector, stores, count):
    """Gives a NODES family one more leaf; `place` is the entry that names the family."""
    lane = integers[family + COUNT]
    capacity = integers[family + CAPACITY]
    if lane < capacity:
        fill_node(integers, floats, family, lane, page, sample, vector, vector, vector)
        return store(stores, count, family + COUNT, lane + 1)
    copy = copy_family(integers, floats, family, 2 * capacity, vector.shape[0])
    fill_node(integers, floats, copy, lane, page, sample, vector, vector, vector)
    integers[copy + COUNT] = lane + 1
    return store(stores, count, place, copy)


@njit(cache=True, nogil=True)
def split_leaf(integers, floats, points, family, lane, page, sample, level, place, stores, count):
    """Puts a family of two in the place of a leaf: the leaf again, with all that it held, and the new sample's leaf.

    The covered samples stay with the leaf, also those that are nearer to the new one, until a repair: the exact search
    goes by boxes and finds them all the same.
    """
    d = points.shape[1]
    old_capacity = integers[family + CAPACITY]
    leaf = integers[family + ENTRIES + lane]
    holder = integers[family + ENTRIES + old_capacity + lane]
    at = lane_at(integers, family, lane, d)
    lower = np.empty(d)
    upper = np.empty(d)
    for t in range(d):
        lower[t] = floats[at + LANES * t]
        upper[t] = floats[at + LANES * (d + t)]
    nodes = add_family(integers, floats, NODES, level, LANES, d)
    fill_node(integers, floats, nodes, 0, leaf, holder, lower, upper, points[holder])
    fill_node(integers, floats, nodes, 1, page, sample, points[sample], points[sample], points[sample])
    integers[nodes + COUNT] = 2
    return store(stores, count, place, nodes)


@njit(cache=True, nogil=True)
def prepare(integers, floats, points, sample, radii, keep_covered, slots, stores, out):
    """Writes what it takes to insert points[sample]; returns an outcome and how many stores make it visible."""
    d = points.shape[1]
    query = points[sample]
    count = 0
    place = ROOT
    family = integers[ROOT]
    outcome = PREPARED
    while True:
        if not has_room(integers, floats, family, d):
            # Boxes have been made wider than need be, for now.
            return NO_ROOM, 0
        level = integers[family + LEVEL]
        lane, square = nearest_lane(query, integers, floats, family, MOST_SAMPLES, out)
        if lane < 0 or math.sqrt(square) > radii[level - 1]:
            page = new_page(integers, floats, level, sample, query, slots)
            count = add_node(integers, floats, family, place, page, sample, query, stores, count)
            note_depth(integers, level, 1)
            break
        widen_box(floats, lane_at(integers, family, lane, d), query)
        parent = family
        place = family + ENTRIES + lane
        family = integers[place]
        if integers[family + KIND] == NODES:
            continue
        if level < radii.shape[0] and math.sqrt(square) > radii[level]:
            page = new_page(integers, floats, level + 1, sample, query, slots)
            count = split_leaf(integers, floats, points, parent, lane, page, sample, level + 1, place, stores, count)
            note_depth(integers, level + 1, 1)
        elif keep_covered:
            count = add_covered(integers, floats, points, family, place, sample, slots, stores, count, out)
        else:
            outcome = COVERED
        break
    if outcome == PREPARED and integers[FLAT]:
        count = add_to_flat(integers, floats, query, sample, stores, count)
    return outcome, store(stores, count, SAMPLES, sample + 1)


@njit(cache=True, nogil=True)
def remove(integers, sample, slots):
    """Takes a sample out of its page; its node, if it has one, stays as a signpost."""
    integers[slots[sample]] = -1 - sample
    flat = integers[FLAT]
    if flat:
        for lane in range(integers[flat + COUNT]):
            if integers[flat + ENTRIES + lane] == sample:
                integers[flat + ENTRIES + lane] = -1 - sample
