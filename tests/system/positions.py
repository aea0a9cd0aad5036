"""Whether a message carries a position, whatever it calls it: three numbers that stand one after the other in it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_SAME = 2e-5  # m: a position that was rounded to a float is the same one; the hand's own reckoning is not

_STEPS = {"<f8": (8, 9), "<f4": (4, 5)}
"""From one number to the next, in bytes: as in an array, and as in fields of a message with a tag each."""


def carries(payload: bytes, positions: NDArray[np.float64]) -> bool:
    """Whether any of `positions` (n, 3) in m stands in the payload, as doubles or floats, at any byte."""
    return any(
        _carries(payload, positions, kind, step, first)
        for kind, steps in _STEPS.items()
        for step in steps
        for first in range(np.dtype(kind).itemsize)
    )


def _carries(payload: bytes, positions: NDArray[np.float64], kind: str, step: int, first: int) -> bool:
    size = np.dtype(kind).itemsize
    count = (len(payload) - first - 2 * step) // size
    if count < 1:
        return False
    numbers = [np.frombuffer(payload, kind, count, first + axis * step) for axis in range(3)]
    lower, upper = positions.min(axis=0) - _SAME, positions.max(axis=0) + _SAME
    with np.errstate(invalid="ignore"):  # most bytes are no numbers
        near = np.logical_and.reduce(
            [(low <= axis) & (axis <= high) for axis, low, high in zip(numbers, lower, upper, strict=True)]
        )
    found = np.column_stack([axis[near].astype(np.float64) for axis in numbers])
    return any(bool((np.abs(positions - each).max(axis=1) < _SAME).any()) for each in found)
