"""The points that near-neighbour searches are compared on.

Generated sets are drawn anew from a seed: nothing is stored. The recorded one lies in `benchmarks/data` and comes from
`benchmarks/record_lab.py`. Queries are fresh points of the same distribution. Settings are chosen on `tuning`, figures
reported on `queries`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

ROOT = Path(__file__).parents[2]
LAB = ROOT / "benchmarks" / "data" / "lab_grasp.npz"

LATENT = 6
"""Dimension of the manifolds: six joints move an arm, however many numbers its sensors give."""
BENDS = 12
"""How many tanh ridges bend a manifold."""

LAB_SCALES = np.array([30.0, 30.0, 10.0, *[0.15] * 6])
"""px, px, px, then rad: what counts as one unit of distance in the recorded set, as module IJS declares it."""
HELD_OUT = 3
"""Recorded demonstrations kept for the queries, and as many for tuning."""


class Problem(NamedTuple):
    """Points to search among, and queries of two kinds; all float64 with d components."""

    points: Floats
    """(n, d)"""
    queries: Floats
    """(q, d) those whose figures are reported."""
    tuning: Floats
    """(q, d) others, for choosing a system's settings."""


class Recording(NamedTuple):
    """Sensorimotor samples recorded in the lab: m samples, in the order in which they were shown."""

    demonstration: Integers
    """(m,) which demonstration, counted from 0."""
    subtask: Integers
    """(m,) which part of the grasp: 0 approach, 1 grasp, 2 lift."""
    inputs: Floats
    """(m, 9) the vector hand -> object as (delta row, delta column, delta disparity) in px, then six joints in rad."""
    outputs: Floats
    """(m, 6) how far each joint is to turn until the subtask's end, rad."""


def gaussian(n: int, d: int, seed: int, queries: int = 1000) -> Problem:
    """n standard normal points with d components."""
    return Problem(*(_stream(seed, use).normal(size=(size, d)) for use, size in enumerate((n, queries, queries))))


def manifold(n: int, ambient: int, seed: int, queries: int = 1000) -> Problem:
    """n points on a smooth 6-D surface in `ambient` dimensions, free of noise.

    x = A z + B tanh(C z) of six standard normal z; A, B and C are drawn from the seed, scaled so that C z and A z have
    about unit variance. Then the bends make about two sevenths of each component's variance.
    """
    shape = _stream(seed, 3)
    linear = shape.normal(size=(LATENT, ambient)) / np.sqrt(LATENT)
    ridges = shape.normal(size=(LATENT, BENDS)) / np.sqrt(LATENT)
    bends = shape.normal(size=(BENDS, ambient)) / np.sqrt(BENDS)

    def draw(use: int, size: int) -> Floats:
        latent = _stream(seed, use).normal(size=(size, LATENT))
        drawn: Floats = latent @ linear + np.tanh(latent @ ridges) @ bends
        return drawn

    return Problem(draw(0, n), draw(1, queries), draw(2, queries))


def recording(path: Path = LAB) -> Recording:
    """The recorded set as it lies in the file."""
    with np.load(path, allow_pickle=False) as stored:
        return Recording(
            stored["demonstration"].astype(np.int64),
            stored["subtask"].astype(np.int64),
            stored["inputs"],
            stored["outputs"],
        )


def lab(path: Path = LAB) -> Problem:
    """The recorded inputs in units of `LAB_SCALES`; the last demonstrations are the queries, those before them tune."""
    taken = recording(path)
    inputs = taken.inputs / LAB_SCALES
    from_end = taken.demonstration.max() - taken.demonstration
    return Problem(
        inputs[from_end >= 2 * HELD_OUT],
        inputs[from_end < HELD_OUT],
        inputs[(from_end >= HELD_OUT) & (from_end < 2 * HELD_OUT)],
    )


GENERATED: dict[str, Callable[[int, int], Problem]] = {
    "3-D Gaussian": lambda n, seed: gaussian(n, 3, seed),
    "6-D Gaussian": lambda n, seed: gaussian(n, 6, seed),
    "6-D manifold in 11-D": lambda n, seed: manifold(n, 11, seed),
    "6-D manifold in 16-D": lambda n, seed: manifold(n, 16, seed),
}
"""The generated sets by name, as functions of the number of points and the seed."""


def _stream(seed: int, use: int) -> np.random.Generator:
    """Random numbers of their own for each use of a seed."""
    return np.random.default_rng([seed, use])
