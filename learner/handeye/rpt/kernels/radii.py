"""Radii under which nodes have a bounded number of children (`handeye.rpt.radii`)."""

import math

import numpy as np
from numba import njit

from handeye.rpt.kernels.lanes import LANES, point_squares
from handeye.rpt.kernels.layout import put_vector, whole_chunks
from handeye.rpt.kernels.rows import corners

LOOKED_AT = 256  # samples in whose midst T(1) is found, or one in SHARE where that is more
SHARE = 16
SPREAD = 4096  # most of those, and samples from which the cells of lower levels are filled
PLACES = 4  # cells looked at on each of those levels
CELL = 256  # most samples of such a cell
STEPS = 8  # of the bisection: a radius is found to within 1.4 %
NARROWEST = 1 / 32  # of the radius above; smaller steps between levels would make clusters fan out without bound


@njit(cache=True, nogil=True)
def largest_square(radius):
    """The largest number whose root is not above the radius: trees compare distances, not their squares."""
    square = radius * radius
    while math.sqrt(square) > radius:
        square = np.nextafter(square, 0.0)
    while math.sqrt(np.nextafter(square, np.inf)) <= radius:
        square = np.nextafter(square, np.inf)
    return square


@njit(cache=True, nogil=True)
def covering_number(points, chosen, radius, most):
    """How many samples, taken in order as they lie farther than `radius` from those taken before, cover
    points[chosen]; stops counting above `most`."""
    d = points.shape[1]
    centres = np.full(whole_chunks(most + 1) * d, np.inf)
    square = largest_square(radius)
    out = np.empty(LANES)
    count = 0
    for i in range(chosen.shape[0]):
        query = points[chosen[i]]
        covered = False
        for base in range(0, count, LANES):
            mask = point_squares(centres, base * d, query, square, out)
            if count - base < LANES:
                mask &= (1 << (count - base)) - 1
            if mask:
                covered = True
                break
        if not covered:
            if count == most:
                return most + 1
            put_vector(centres, count // LANES * LANES * d + count % LANES, query)
            count += 1
    return count


@njit(cache=True, nogil=True)
def smallest_radius(points, cells, bounds, widest, fan_out):
    """By bisection of its logarithm: the smallest radius under which fan_out nodes cover each of the cells; cell c is
    cells[bounds[c]:bounds[c + 1]]."""
    low = widest * NARROWEST
    high = widest
    for _ in range(STEPS):
        middle = math.sqrt(low * high)
        enough = True
        for c in range(bounds.shape[0] - 1):
            if covering_number(points, cells[bounds[c] : bounds[c + 1]], middle, fan_out) > fan_out:
                enough = False
                break
        if enough:
            high = middle
        else:
            low = middle
    return high


@njit(cache=True, nogil=True)
def evenly(n, most):
    """Up to `most` of the numbers 0 to n - 1, evenly spread."""
    size = min(n, most)
    numbers = np.zeros(size, np.int64)
    for i in range(1, size):
        numbers[i] = i * (n - 1) // (size - 1)
    return numbers


@njit(cache=True, nogil=True)
def fill_cells(points, spread, radius, cells, bounds):
    """Fills cells[bounds[c]:bounds[c + 1]] with the samples within a radius of one of some places."""
    places = evenly(spread.shape[0], PLACES)
    bounds[:] = 0
    for c in range(places.shape[0]):
        centre = points[spread[places[c]]]
        count = bounds[c]
        for sample in spread:
            if count < bounds[c] + CELL:
                square = 0.0
                for t in range(centre.shape[0]):
                    square += (points[sample, t] - centre[t]) ** 2
                if math.sqrt(square) <= radius:
                    cells[count] = sample
                    count += 1
        bounds[c + 1 :] = count


@njit(cache=True, nogil=True)
def derive(points, fan_out, leaf):
    """The radii of `handeye.rpt.radii.derive_radii`; none when all samples looked at coincide."""
    n, d = points.shape
    levels = 1
    nodes = fan_out
    while leaf * nodes < n:
        levels += 1
        nodes *= fan_out
    radii = np.empty(levels)
    spread = evenly(n, min(max(n // SHARE, LOOKED_AT), SPREAD))
    rows = points[spread]
    lower = np.empty(d)
    upper = np.empty(d)
    corners(rows, 0, rows.shape[0], lower, upper)
    widest = 0.0
    for t in range(d):
        widest += (upper[t] - lower[t]) ** 2
    widest = math.sqrt(widest)
    if widest == 0.0:
        return radii[:0]
    radii[0] = smallest_radius(points, spread, np.array([0, spread.shape[0]]), widest, fan_out)
    cells = np.empty(PLACES * CELL, np.int64)
    bounds = np.empty(PLACES + 1, np.int64)
    spread = evenly(n, SPREAD)
    for level in range(1, levels):
        fill_cells(points, spread, radii[level - 1], cells, bounds)
        radii[level] = smallest_radius(points, cells, bounds, radii[level - 1], fan_out)
        if radii[level] >= 0.9 * radii[level - 1]:
            # The samples here are as dense as they get: another level would divide nothing.
            return radii[:level]
    return radii
