"""How long one more sample takes, and whether the next query knows it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from benchmarks.learner.data import GENERATED, Floats, lab
from benchmarks.learner.ours import outputs_of, taught
from handeye.rpt import build
from handeye.rpt.region import STALE

LEAST = 1000
"""Samples inserted; more, where fewer would not contain one recalibration of the model."""
WARM_UP = 60
"""Samples of another tree, whose insertion loads the compiled code."""
LAB = "lab grasp, 9-D"


class Insertion(NamedTuple):
    """µs for one sample; every one was looked for, and found by the very next query."""

    points: str
    n: int
    """Samples before."""
    more: int
    """Samples inserted, one per call."""
    what: str
    median: float
    mean: float
    """Growth of arrays and recalibrations included."""
    longest: float


def insertion(name: str, n: int, seed: int, *, model: bool) -> Insertion:
    """`Model.learn` or `Tree.insert` of one sample at a time."""
    before, new = _samples(name, n, seed)
    inserter = _learner if model else _tree
    inserter(before[:WARM_UP])(before[0] + 1e-3)
    insert = inserter(before)
    spent = np.array([insert(sample) for sample in new]) / 1e3
    what = "Model.learn" if model else "Tree.insert"
    return Insertion(
        name, len(before), len(new), what, float(np.median(spent)), float(spent.mean()), float(spent.max())
    )


def _samples(name: str, n: int, seed: int) -> tuple[Floats, Floats]:
    if name == LAB:
        recorded = lab()
        return recorded.points, np.concatenate([recorded.tuning, recorded.queries])
    points = GENERATED[name](n + max(LEAST, int(STALE * n) + 1), seed).points
    return points[:n], points[n:]


def _tree(before: Floats) -> Callable[[Floats], int]:
    tree = build(before)

    def insert(sample: Floats) -> int:
        begin = time.perf_counter_ns()
        number = tree.insert(sample)[0]
        spent = time.perf_counter_ns() - begin
        nearest, distance = tree.exact(sample, 1)
        _seen(int(nearest[0]), float(distance[0]), int(number))
        return spent

    return insert


def _learner(before: Floats) -> Callable[[Floats], int]:
    model = taught(before)

    def insert(sample: Floats) -> int:
        inputs = sample[np.newaxis]
        outputs = outputs_of(inputs)
        begin = time.perf_counter_ns()
        number = model.learn(inputs, outputs)[0]
        spent = time.perf_counter_ns() - begin
        answer = model.answer(sample)
        _seen(int(answer.ids[0]), float(answer.distances[0]), int(number))
        return spent

    return insert


def _seen(nearest: int, distance: float, number: int) -> None:
    if nearest != number or distance != 0.0:
        raise AssertionError(f"sample {number} was inserted, but the next query found {nearest} at {distance}")
