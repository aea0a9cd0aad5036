"""Radial lens distortion: as points, and as the resampling that bends a pinhole picture.

The model is Brown's (1966), as OpenCV has it: with (x, y) = (X/Z, Y/Z) and r^2 = x^2 + y^2, the picture shows the point
at (x, y) * (1 + k1 r^2 + k2 r^4).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
"""Points (..., 2) on the plane Z = 1 of the optical frame, as (x, y)."""

_NEWTON_STEPS = 12


def distort(points: Points, k1: float, k2: float) -> Points:
    """Where the lens shows ideal points (..., 2)."""
    squared = np.sum(np.square(points), axis=-1, keepdims=True)
    result: Points = points * (1.0 + squared * (k1 + squared * k2))
    return result


def undistort(points: Points, k1: float, k2: float) -> Points:
    """The ideal points (..., 2) that the lens shows at `points`: the inverse of `distort`.

    `ValueError` where the distortion folds over (so strong that no ideal point belongs to a picture point).
    """
    shown = np.linalg.norm(points, axis=-1, keepdims=True)
    ideal = shown.copy()
    for _ in range(_NEWTON_STEPS):
        squared = ideal**2
        slope = 1.0 + squared * (3.0 * k1 + 5.0 * k2 * squared)
        ideal -= (ideal * (1.0 + squared * (k1 + squared * k2)) - shown) / slope
    squared = ideal**2
    slope = 1.0 + squared * (3.0 * k1 + 5.0 * k2 * squared)
    residual = np.abs(ideal * (1.0 + squared * (k1 + squared * k2)) - shown)
    if not (np.all(slope > 0) and np.all(residual < 1e-12)):
        raise ValueError(f"the distortion k1={k1}, k2={k2} cannot be inverted over the whole picture")
    ratio = np.divide(ideal, shown, out=np.ones_like(shown), where=shown > 0)
    result: Points = points * ratio
    return result


def bending_maps(
    width: int, height: int, focal_length: float, principal: tuple[float, float], k1: float, k2: float
) -> NDArray[np.float32]:
    """Where each pixel of the bent picture is found on the ideal pinhole picture.

    `principal` is (row, column) in pixels. Returns (height, width, 2) as (column, row) in pixels of an endless pinhole
    picture with the same focal length and principal point.
    """
    row, column = principal
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    shown = np.stack([columns - column, rows - row], axis=-1) / focal_length
    found = undistort(shown, k1, k2) * focal_length + (column, row)
    return found.astype(np.float32)
