"""What a learner finds out about itself: gradients at the samples, and answers to samples that were left out."""

import math

import numpy as np
from numba import njit

from handeye.rpt.kernels.answer import (
    ANSWERED,
    ESTIMATED,
    GIVEN,
    GRADIENT_NEIGHBOURS,
    LEAF_MAP,
    LIMIT,
    METHOD,
    NEIGHBOURS,
    OUTPUTS,
    RIDGE,
    RULE,
    SMOOTHING,
    UNDETERMINED,
    answer,
    fit_weights,
    interpolate_fit,
    row_of,
    workspace,
)
from handeye.rpt.kernels.fit import leaf_map
from handeye.rpt.kernels.lanes import LANES
from handeye.rpt.kernels.layout import COUNT, ENTRIES, FLAT, SAMPLES, WAITING
from handeye.rpt.kernels.search import exact, offer


@njit(cache=True, nogil=True)
def estimate_gradients(chosen, integers, floats, points, knowledge, rows, rule, targets):
    """Gradients at the chosen samples, each into the row of `knowledge` that `targets` names, its outputs copied too.

    For KNDB2 slopes of local linear fits to the nearest samples, for leaf maps the maps that the nearest samples make.
    """
    d = points.shape[1]
    p = int(rule[OUTPUTS])
    k = int(rule[GRADIENT_NEIGHBOURS])
    ids = np.empty(k, np.int64)
    squares = np.empty(k)
    weights = np.empty(k)
    stack = np.empty((integers[WAITING], 3))
    scratch = np.empty(LANES)
    value = np.empty(p)
    slope = np.empty((p, d))
    for i in range(chosen.shape[0]):
        sample = chosen[i]
        source = row_of(rows, sample)
        target = targets[i]
        knowledge[target] = knowledge[source]
        if knowledge[target, p + p * d] == GIVEN:
            continue
        query = points[sample]
        count = exact(query, integers, floats, integers[SAMPLES], ids, squares, stack, scratch)
        slope[:] = 0.0
        determined = False
        if count and rule[METHOD] == LEAF_MAP:
            inputs = np.empty((count, d))
            outputs = np.empty((count, p))
            for j in range(count):
                inputs[j] = points[ids[j]]
                outputs[j] = knowledge[row_of(rows, ids[j]), :p]
            determined = leaf_map(query, knowledge[source, :p], inputs, outputs, rule[RIDGE], slope)
        elif count:
            fit_weights(squares, count, rule[SMOOTHING], weights)
            ridges = (rule[RIDGE], rule[RIDGE])
            determined = interpolate_fit(query, points, knowledge, rows, ids, count, weights, 1, ridges, value, slope)
        for b in range(p):
            for a in range(d):
                knowledge[target, p + b * d + a] = slope[b, a]
        knowledge[target, p + p * d] = ESTIMATED if determined else UNDETERMINED
        knowledge[target, p + p * d + 1] = math.sqrt(squares[k - 1]) if count == k else np.inf


@njit(cache=True, nogil=True)
def joined_by(first, last, k, integers, floats, points, knowledge, rows):
    """Which samples before `first` have neighbourhoods that samples first to last - 1 now belong to, ascending.

    They are looked for among the k nearest of each new sample.
    """
    found = np.empty((last - first) * k, np.int64)
    ids = np.empty(k, np.int64)
    squares = np.empty(k)
    stack = np.empty((integers[WAITING], 3))
    scratch = np.empty(LANES)
    reach = knowledge.shape[1] - 1
    size = 0
    for new in range(first, last):
        count = exact(points[new], integers, floats, integers[SAMPLES], ids, squares, stack, scratch)
        for j in range(count):
            if ids[j] < first and math.sqrt(squares[j]) < knowledge[rows[ids[j]], reach]:
                found[size] = ids[j]
                size += 1
    return np.unique(found[:size])


@njit(cache=True, nogil=True)
def estimated_from(removed, points, knowledge, rows):
    """Which of the first rows.shape[0] samples have gradients that any of the `removed` samples took part in."""
    d = points.shape[1]
    found = np.zeros(rows.shape[0], np.bool_)
    for sample in range(rows.shape[0]):
        reach = knowledge[rows[sample], knowledge.shape[1] - 1]
        for i in range(removed.shape[0]):
            total = 0.0
            for t in range(d):
                step = points[sample, t] - points[removed[i], t]
                total += step * step
            if math.sqrt(total) <= reach:
                found[sample] = True
                break
    return found


@njit(cache=True, nogil=True)
def publish_rows(rows, chosen, targets):
    """Makes new rows of `knowledge` those of the chosen samples."""
    for i in range(chosen.shape[0]):
        rows[chosen[i]] = targets[i]


@njit(cache=True, nogil=True)
def set_entries(integers, slots, members, removed):
    """Hides samples from searches, or shows them again."""
    for i in range(members.shape[0]):
        slot = slots[members[i]]
        if slot >= 0:
            integers[slot] = -1 - members[i] if removed else members[i]
    flat = integers[FLAT]
    if flat == 0:
        return
    for lane in range(integers[flat + COUNT]):
        entry = integers[flat + ENTRIES + lane]
        sample = -1 - entry if entry < 0 else entry
        for i in range(members.shape[0]):
            if members[i] == sample:
                integers[flat + ENTRIES + lane] = -1 - sample if removed else sample


@njit(cache=True, nogil=True)
def leave_out(integers, floats, slots, points, knowledge, rows, rule, members, bounds, asked, answers):
    """Answers to samples, each from all samples but those of its own group; returns which were answered.

    members[bounds[g]:bounds[g + 1]] are the samples of group g; asked[i] says whether members[i] is to be answered,
    into answers[i]. Changes integers and rows meanwhile: give it copies. Where methods use tangents, `knowledge` has as
    many spare rows at its end as neighbours are asked for: there the tangents stand that do not know the group.
    """
    d = points.shape[1]
    n_known = knowledge.shape[0] - int(rule[NEIGHBOURS])
    plain = rule.copy()
    plain[RULE:] = 1.0  # the points are scaled already
    plain[LIMIT] = integers[SAMPLES]
    work = workspace(np.empty(0), integers[WAITING], plain, d)
    scores = np.empty(0)
    ids, squares, stack, scratch = work[0], work[1], work[3], work[4]
    answered = np.zeros(members.shape[0], np.bool_)
    for g in range(bounds.shape[0] - 1):
        group = members[bounds[g] : bounds[g + 1]]
        if not np.any(asked[bounds[g] : bounds[g + 1]]):
            continue
        set_entries(integers, slots, group, True)
        for i in range(bounds[g], bounds[g + 1]):
            if not asked[i]:
                continue
            query = points[members[i]]
            near = ids[:0].copy()
            before = near
            if rows.shape[0]:
                count = exact(query, integers, floats, integers[SAMPLES], ids, squares, stack, scratch)
                near = ids[:count].copy()
                before = rows[near].copy()
                spare = n_known + np.arange(count)
                estimate_gradients(near, integers, floats, points, knowledge, rows, plain, spare)
                publish_rows(rows, near, spare)
            outcome = answer(query, integers, floats, points, knowledge, rows, plain, scores, work, answers[i])
            answered[i] = outcome == ANSWERED
            publish_rows(rows, near, before)
        set_entries(integers, slots, group, False)
    return answered


@njit(cache=True, nogil=True)
def nearby_means(points, labels, residuals, nearby):
    """(m, p) for each of m points the mean residual of the `nearby` nearest points with another label."""
    m, d = points.shape
    means = np.zeros(residuals.shape)
    squares = np.empty(nearby)
    ids = np.empty(nearby, np.int64)
    for i in range(m):
        count = 0
        for j in range(m):
            if labels[j] == labels[i]:
                continue
            square = 0.0
            for t in range(d):
                square += (points[i, t] - points[j, t]) ** 2
            if count < nearby or square < squares[nearby - 1]:
                count = offer(ids, squares, count, square, j)
        for j in range(count):
            means[i] += residuals[ids[j]] / count
    return means


@njit(cache=True, nogil=True)
def expect(queries, integers, floats, limit, nearby, residuals, floor, quantile, expected):
    """Expected errors (q, p): the quantile times the mean of the `nearby` nearest residuals (m, p), floor added."""
    p = residuals.shape[1]
    stack, out = np.empty((integers[WAITING], 2)), np.empty(LANES)
    ids, squares = np.empty(nearby, np.int64), np.empty(nearby)
    for i in range(queries.shape[0]):
        exact(queries[i], integers, floats, limit, ids, squares, stack, out)
        for j in range(p):
            total = 0.0
            for sample in ids:
                total += residuals[sample, j]
            expected[i, j] = quantile[j] * (total / nearby + floor[j]) if math.isfinite(quantile[j]) else math.inf
