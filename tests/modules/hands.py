"""Hands as a stereo camera without lens distortion sees them: their place, their turn, an object before them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handeye.modules import css
from handeye.modules.module import Module
from handeye.modules.spaces import HandPoint, ImagePair, ImagePoint

FOCAL, BASELINE = 600.0, 0.3
HALF = 0.035  # m
CORNERS = HALF * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0.0]])
WAY = np.array([0.02, -0.07, 0.11])
"""From hand to object: right, up, out, in m."""
FACING = np.diag([1.0, -1.0, -1.0])
"""The axes of a marker that is read straight: its up is the camera's -y."""

Array = NDArray[np.float64]


def seen(points: Array) -> Array:
    """(n, 3) m in the camera's frame -> (n, 3) row, column, disparity."""
    x, y, z = points.T
    return np.column_stack([240 + FOCAL * y / z, 320 + FOCAL * x / z, FOCAL * BASELINE / z])


def metric_css() -> Module:
    """Module CSS as many grids would have taught it."""
    module = Module(css.DECLARATION)
    steps = [np.linspace(-0.3, 0.3, 18), np.linspace(-0.3, 0.3, 18), np.linspace(0.7, 1.3, 18)]
    points = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 3)
    module.learn(seen(points), points, ["grid"] * len(points))
    return module


def turned(rotation: tuple[float, float, float]) -> Array:
    """Rotation matrix (3, 3) of a vector in rad."""
    angle = float(np.linalg.norm(rotation)) or 1.0
    x, y, z = np.array(rotation) / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix: Array = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return matrix


def look(place: Array, axes: Array) -> ImagePair:
    """A hand at `place` (3,) with `axes` (3, 3) as columns, and an object `WAY` from it."""
    hand, *corners, thing = seen(place + np.array([np.zeros(3), *CORNERS, WAY]) @ axes.T).tolist()
    return ImagePair(ImagePoint(*thing), HandPoint(hand[0], hand[1], hand[2], tuple(map(tuple, corners))))
