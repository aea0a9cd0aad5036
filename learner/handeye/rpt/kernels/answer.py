"""From a query to an answer: search, weights, interpolation, support (thesis 3.3).

`knowledge` holds what is known at each sample: its outputs (p) and, for methods that use tangents, their gradient
(p d), how it came about (1: UNDETERMINED, ESTIMATED or GIVEN) and how far away the samples lie that it was estimated
from (1: infinite while there are too few, negative for a given one). `rows` names the row of each sample, so that a
writer can put a better gradient into a new row and publish it with one store; when it is empty the row is the sample's
number. `scores` are the calibrated distances that support compares with, ascending.
"""

import math
from collections.abc import Callable

import numpy as np
from numba import njit

from handeye.rpt.kernels.fit import local_fit
from handeye.rpt.kernels.lanes import LANES
from handeye.rpt.kernels.layout import WAITING
from handeye.rpt.kernels.search import beam, exact
from handeye.rpt.kernels.table import floats_at, integers_at, matrix_at, scratch

# Methods, in the order of `settings.METHODS`.
NEAREST = 0
KNDB = 1
KNDB2 = 2
LOCAL_LINEAR = 3
LOCAL_QUADRATIC = 4
LEAF_MAP = 5

# How a gradient came about.
UNDETERMINED = 0.0
ESTIMATED = 1.0
GIVEN = 2.0

# Fields of a rule, an array of numbers.
METHOD = 0
NEIGHBOURS = 1
OUTPUTS = 2
ALPHA = 3
SMOOTHING = 4
RIDGE = 5
CURVATURE_RIDGE = 6
BEAM_WIDTH = 7  # 0 for the exact search
GRADIENT_NEIGHBOURS = 8
LIMIT = 9  # samples with a smaller number are known
RULE = 10  # here begin the factors that each input component is multiplied with

# Entries of the table that `answer_one` takes.
INTEGERS, FLOATS, POINTS, KNOWLEDGE, ROWS, RULE_ENTRY, SCORES = range(7)

EPSILON = 1e-12
"""Keeps KNDB's exponent finite at a sample, in units of the distance."""

# An answer is a row of numbers: outputs (p), gradient (p d), these three, then ids, distances and weights (k each) of
# the neighbours and the scaled query (d).
SUPPORT = 0
DETERMINED = 1
FOUND = 2
EXTRAS = 3

LARGEST = 1e150
"""Larger components would overflow when squared."""

# What `answer` returns.
ANSWERED = 1
NOTHING_FOUND = 0
NOT_FINITE = -1
WRONG_LENGTH = -2


@njit(cache=True, nogil=True)
def row_length(outputs, components, neighbours):
    """How many numbers an answer's row has."""
    return outputs * (1 + components) + EXTRAS + 3 * neighbours + components


@njit(cache=True, nogil=True)
def p_value(scores, score):
    """Share of calibrated scores that are at least as large, the query itself counted among them."""
    low = 0
    high = scores.shape[0]
    while low < high:
        middle = (low + high) // 2
        if scores[middle] < score:
            low = middle + 1
        else:
            high = middle
    return (1.0 + scores.shape[0] - low) / (1.0 + scores.shape[0])


@njit(cache=True, nogil=True)
def kndb_weights(squares, count, alpha, weights):
    """w_j / w with w_j = alpha^(-|Q - Q_j| / (epsilon + |Q - Q_1|)), counted from the nearest."""
    nearest = math.sqrt(squares[0])
    factor = -math.log(alpha) / (EPSILON + nearest)
    total = 0.0
    for i in range(count):
        weights[i] = math.exp(factor * (math.sqrt(squares[i]) - nearest))
        total += weights[i]
    for i in range(count):
        weights[i] /= total


@njit(cache=True, nogil=True)
def fit_weights(squares, count, smoothing, weights):
    """Proportional to 1 / (D_j^2 + (smoothing D_k)^2); they add up to 1."""
    farthest = squares[count - 1]
    total = 0.0
    for i in range(count):
        weights[i] = 1.0 / (squares[i] / farthest + smoothing * smoothing) if farthest > 0.0 else 1.0
        total += weights[i]
    for i in range(count):
        weights[i] /= total


@njit(cache=True, nogil=True)
def row_of(rows, sample):
    """Where in `knowledge` a sample's numbers stand."""
    return rows[sample] if rows.shape[0] else sample


@njit(cache=True, nogil=True)
def interpolate_weighted(query, points, knowledge, rows, ids, count, weights, value, slope):
    """The neighbours' outputs by their weights, each along its tangent where there is one (KNDB2, leaf maps).

    Returns whether all tangents used are determined.
    """
    d = query.shape[0]
    p = value.shape[0]
    tangents = knowledge.shape[1] > p
    value[:] = 0.0
    slope[:] = 0.0
    determined = True
    for i in range(count):
        row = row_of(rows, ids[i])
        w = weights[i]
        for b in range(p):
            said = knowledge[row, b]
            if tangents:
                for a in range(d):
                    g = knowledge[row, p + b * d + a]
                    said += g * (query[a] - points[ids[i], a])
                    slope[b, a] += w * g
            value[b] += w * said
        if tangents and knowledge[row, p + p * d] == UNDETERMINED:
            determined = False
    return determined


@njit(cache=True, nogil=True)
def interpolate_fit(query, points, knowledge, rows, ids, count, weights, degree, ridges, value, slope):
    """A local polynomial through the neighbours; returns whether they determine it (`local_fit`)."""
    inputs = np.empty((count, query.shape[0]))
    outputs = np.empty((count, value.shape[0]))
    for i in range(count):
        row = row_of(rows, ids[i])
        inputs[i] = points[ids[i]]
        for b in range(value.shape[0]):
            outputs[i, b] = knowledge[row, b]
    return local_fit(query, inputs, outputs, weights[:count], degree, ridges[0], ridges[1], value, slope)


@njit(cache=True, nogil=True)
def interpolate(query, points, knowledge, rows, ids, squares, count, rule, weights, value, slope):
    """Fills weights, value (p,) and slope (p, d) from the neighbours by the rule.

    Returns whether the neighbours determine the answer's slopes.
    """
    method = int(rule[METHOD])
    if method in (LOCAL_LINEAR, LOCAL_QUADRATIC):
        fit_weights(squares, count, rule[SMOOTHING], weights)
        degree = 1 if method == LOCAL_LINEAR else 2
        ridges = (rule[RIDGE], rule[CURVATURE_RIDGE])
        return interpolate_fit(query, points, knowledge, rows, ids, count, weights, degree, ridges, value, slope)
    if method in (KNDB, KNDB2):
        kndb_weights(squares, count, rule[ALPHA], weights)
    else:
        weights[:count] = 0.0
        weights[0] = 1.0
        count = 1
    return interpolate_weighted(query, points, knowledge, rows, ids, count, weights, value, slope)


@njit(cache=True, nogil=True)
def answer(query, integers, floats, points, knowledge, rows, rule, scores, work, row):
    """Fills a row as described above; returns ANSWERED or what is in the way."""
    ids, squares, weights, stack, scratch, value, slope, scaled = work
    p, d = slope.shape
    k = ids.shape[0]
    if query.shape[0] != d:
        return WRONG_LENGTH
    for a in range(d):
        scaled[a] = query[a] * rule[RULE + a]
        if not abs(scaled[a]) <= LARGEST:
            return NOT_FINITE
    width = int(rule[BEAM_WIDTH])
    limit = int(rule[LIMIT])
    squares[0] = np.inf
    if k == 0:
        return NOTHING_FOUND
    if width:
        count, _ = beam(scaled, integers, floats, limit, width, ids, squares, stack, scratch)
    else:
        count = exact(scaled, integers, floats, limit, ids, squares, stack, scratch)
    if count == 0:
        return NOTHING_FOUND
    determined = interpolate(scaled, points, knowledge, rows, ids, squares, count, rule, weights, value, slope)
    extras = p + p * d
    row[extras + SUPPORT] = p_value(scores, math.sqrt(squares[0]))
    row[extras + DETERMINED] = determined
    row[extras + FOUND] = count
    for b in range(p):
        row[b] = value[b]
        for a in range(d):
            row[p + b * d + a] = slope[b, a] * rule[RULE + a]
    end = extras + EXTRAS
    for i in range(count):
        row[end + i] = ids[i]
        row[end + k + i] = math.sqrt(squares[i])
        row[end + 2 * k + i] = weights[i]
    for i in range(count, k):
        row[end + i] = -1.0
        row[end + k + i] = np.inf
        row[end + 2 * k + i] = 0.0
    for a in range(d):
        row[end + 3 * k + a] = scaled[a]
    return ANSWERED


@njit(cache=True, nogil=True)
def workspace(memory, waiting, rule, d):
    """What `answer` needs beside its arguments, from one piece of memory, if that is large enough."""
    k = int(rule[NEIGHBOURS])
    p = int(rule[OUTPUTS])
    height = waiting + int(rule[BEAM_WIDTH])
    needed = 3 * k + 1 + 3 * height + LANES + p + p * d + d
    if needed > memory.shape[0]:
        memory = np.empty(needed)
    end = k
    ids = memory[:end].view(np.int64)
    start, end = end, end + max(k, 1)
    squares = memory[start:end]
    start, end = end, end + k
    weights = memory[start:end]
    start, end = end, end + 3 * height
    stack = memory[start:end].reshape(height, 3)
    start, end = end, end + LANES
    scratch = memory[start:end]
    start, end = end, end + p
    value = memory[start:end]
    start, end = end, end + p * d
    slope = memory[start:end].reshape(p, d)
    return ids, squares, weights, stack, scratch, value, slope, memory[end : end + d]


def _answer_one(query, table, row):
    """`answer` from what a table names; the order of its entries stands above."""
    integers = integers_at(table, INTEGERS)
    rule = floats_at(table, RULE_ENTRY)
    # Asking for eight arrays would cost half a microsecond.
    work = workspace(scratch(), integers[WAITING], rule, rule.shape[0] - RULE)
    return answer(
        query,
        integers,
        floats_at(table, FLOATS),
        matrix_at(table, POINTS),
        matrix_at(table, KNOWLEDGE),
        integers_at(table, ROWS),
        rule,
        floats_at(table, SCORES),
        work,
        row,
    )


answer_one: Callable[..., int] = njit(["int64(float64[::1], int64[::1], float64[::1])"], cache=True, nogil=True)(
    _answer_one
)
"""Compiled for these types alone: anything else is a TypeError, not another compilation."""


@njit(cache=True, nogil=True)
def answer_many(queries, integers, floats, points, knowledge, rows, rule, scores, answers):
    """`answer` for every row of queries; returns the outcome of the first that was not answered."""
    work = workspace(np.empty(0), integers[WAITING], rule, queries.shape[1])
    for i in range(queries.shape[0]):
        outcome = answer(queries[i], integers, floats, points, knowledge, rows, rule, scores, work, answers[i])
        if outcome != ANSWERED:
            return outcome
    return ANSWERED
