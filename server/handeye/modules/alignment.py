"""Sub-pixel alignment of a known pattern with a picture, by Gauss-Newton on the warp.

Forward compositional image alignment (Baker and Matthews, "Lucas-Kanade 20 Years On", IJCV 2004): every pixel of the
pattern takes part, so the noise of a point falls with the root of the number of edge pixels; four corners or a
centroid use far fewer. The warp is a 3×3 homography; which motions are free is said by a list of generators.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
GreyImage = NDArray[np.float32]

_CONVERGED = 4e-4  # half sizes of the pattern: about a hundredth of a pixel

_MIN_PIXELS = 36
_FARTHEST = 4.0  # steps


def _generator(*entries: tuple[int, int, float]) -> FloatArray:
    matrix = np.zeros((3, 3))
    for row, column, value in entries:
        matrix[row, column] = value
    return matrix


SHIFT = (
    _generator((0, 2, 1.0)),
    _generator((1, 2, 1.0)),
)
"""Shift alone: a thing whose size is known."""

SHIFT_AND_SCALE = (
    *SHIFT,
    _generator((0, 0, 1.0), (1, 1, 1.0)),
)
"""Shift and size: a thing seen from nearer or farther."""

UPRIGHT = (
    *SHIFT,
    _generator((0, 0, 1.0)),
    _generator((1, 1, 1.0)),
    _generator((0, 1, 1.0)),
)
"""Shift, width, height, and lean: how the silhouette of a standing thing changes from place to place."""

HOMOGRAPHY = (
    *UPRIGHT,
    _generator((1, 0, 1.0)),
    _generator((2, 0, 1.0)),
    _generator((2, 1, 1.0)),
)
"""All eight motions of a plane seen in perspective."""


@dataclass(frozen=True, slots=True)
class Pattern:
    """A grey pattern over the square [−1, 1]² (x to the right, y down), and its slopes per unit of x and y.

    `layers` has shape (size, size, 4): brightness, ∂/∂x, ∂/∂y, and ones, which tell where a warped pattern ends.
    """

    layers: NDArray[np.float32]

    @classmethod
    def of(cls, brightness: GreyImage) -> Pattern:
        """The pattern of a square array of brightness, shape (size, size)."""
        per_unit = brightness.shape[0] / 2
        slope_y, slope_x = np.gradient(brightness)
        return cls(
            np.dstack((brightness, slope_x * per_unit, slope_y * per_unit, np.ones_like(brightness))).astype(np.float32)
        )

    @property
    def pixels_from_units(self) -> FloatArray:
        """Array index (x, y) from pattern coordinates, 3×3."""
        half = self.layers.shape[0] / 2
        return np.array([[half, 0, half - 0.5], [0, half, half - 0.5], [0, 0, 1.0]])


@dataclass(frozen=True, slots=True)
class Alignment:
    """Where the pattern lies: 3×3 image_from_pattern (image x = column, y = row), and how well it fits.

    `correlation` is that of picture and pattern over the part of the pattern inside the picture, −1…1; hidden pixels
    count too.
    """

    image_from_pattern: FloatArray
    correlation: float

    @property
    def centre(self) -> tuple[float, float]:
        """(row, column) of the pattern's centre in the picture."""
        x, y, w = self.image_from_pattern[:, 2]
        return float(y / w), float(x / w)

    def outline(self) -> FloatArray:
        """(row, column) of the pattern's four corners, shape (4, 2)."""
        corners = np.array([[-1, 1, 1, -1], [-1, -1, 1, 1], [1, 1, 1, 1]], dtype=float)
        x, y, w = self.image_from_pattern @ corners
        return np.stack((y / w, x / w), axis=1)


def predict(
    pattern: Pattern, image_from_pattern: FloatArray, window: tuple[int, int, int, int], subsamples: int
) -> NDArray[np.float32]:
    """What the pixels of `window` (top, left, rows, columns) show of the pattern's layers, zero outside of it.

    Each pixel is the mean over subsamples × subsamples points, as a sensor's pixel averages its area. Shape
    (rows, columns, 4); the last layer is the part of the pixel that the pattern covers.
    """
    top, left, rows, columns = window
    fine = 1 / subsamples
    shift = fine / 2 - 0.5
    image_from_fine = np.array([[fine, 0, left + shift], [0, fine, top + shift], [0, 0, 1.0]])
    pattern_from_fine = pattern.pixels_from_units @ np.linalg.inv(image_from_pattern) @ image_from_fine
    warped = cv2.warpPerspective(
        pattern.layers,
        pattern_from_fine,
        (columns * subsamples, rows * subsamples),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
    )
    return np.asarray(cv2.resize(warped, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.float32)


def align(
    picture: GreyImage,
    pattern: Pattern,
    start: FloatArray,
    motions: tuple[FloatArray, ...],
    *,
    subsamples: int = 1,
    outlier: float = np.inf,
    converged: float = _CONVERGED,
    iterations: int = 8,
) -> Alignment | None:
    """Moves `pattern` from the warp `start` (3×3 image_from_pattern) until it fits `picture` best.

    Gain and offset of the brightness are estimated along with the motions (`SHIFT`, `SHIFT_AND_SCALE`, `UPRIGHT`,
    `HOMOGRAPHY`).
    `subsamples` as in `predict`: 1 will do for smooth patterns, print needs 2 or 3. `outlier`, in the picture's own
    units, is the residual at which a pixel's weight has fallen to a half, for patterns that may be partly hidden.
    A step of less than `converged`, in half sizes of the pattern, is the last one.
    None when the fit diverges or leaves the picture.
    """
    warp = start / start[2, 2]
    generators = np.stack(motions)
    step = way = np.zeros(len(motions))
    for _ in range(iterations):
        look = _look(picture, pattern, warp, subsamples)
        if look is None:
            return None
        seen, (shown, slope_x, slope_y), points = look
        x, y = _velocities(generators, points)
        design = np.concatenate((-slope_x * x - slope_y * y, shown[None], np.ones_like(shown)[None]))
        weighted = design / (1 + ((seen - shown) / outlier) ** 2)  # Cauchy's weights
        try:
            solution = np.linalg.solve((weighted @ design.T).astype(np.float64), (weighted @ seen).astype(np.float64))
        except np.linalg.LinAlgError:
            return None
        gain = solution[-2]
        if gain <= 0:
            return None
        before, step = step, np.clip(solution[:-2] / gain, -0.3, 0.3)
        way = _extrapolated(step, before, way)
        warp = warp @ (np.eye(3) + np.tensordot(way, generators, axes=1))
        warp /= warp[2, 2]
        if np.abs(step).max() < converged:
            return Alignment(warp, _correlation(seen, shown))  # after so small a step it is the same
    look = _look(picture, pattern, warp, subsamples)
    return None if look is None else Alignment(warp, _correlation(look[0], look[1][0]))


def _extrapolated(step: FloatArray, before: FloatArray, way: FloatArray) -> FloatArray:
    """How far to go when this step follows another one, and the way that was gone by that.

    Anderson's acceleration (1965) of depth one: what steps leave over in the same ratio each time, as the lean of a
    silhouette does, is gone at once.
    """
    change = step - before
    if not before.any() or not change.any():
        return step
    further: FloatArray = step - (step @ change) / (change @ change) * (way + change)
    most = _FARTHEST * np.abs(step).max()
    return np.clip(further, -most, most)


def _look(
    picture: GreyImage, pattern: Pattern, warp: FloatArray, subsamples: int
) -> tuple[GreyImage, GreyImage, GreyImage] | None:
    """Of the n pixels under the pattern: what they show (n,), its brightness and slopes (3, n), its points (3, n)."""
    window = _window(warp, picture.shape)
    if window is None:
        return None
    top, left, rows, columns = window
    layers = predict(pattern, warp, window, subsamples).reshape(-1, 4)
    inside = layers[:, 3] > 0.999
    if np.count_nonzero(inside) < _MIN_PIXELS:
        return None
    seen = picture[top : top + rows, left : left + columns].ravel()[inside]
    return seen, np.compress(inside, layers, axis=0).T[:3], _pattern_points(warp, window)[:, inside]


def _window(warp: FloatArray, shape: tuple[int, ...]) -> tuple[int, int, int, int] | None:
    """The part of the picture under the pattern, (top, left, rows, columns); None when there is hardly any."""
    corners = Alignment(warp, 0.0).outline()
    if not np.isfinite(corners).all():
        return None
    top, left = np.maximum(np.floor(corners.min(axis=0)), 0).astype(int)
    bottom, right = np.minimum(np.ceil(corners.max(axis=0)) + 1, shape[:2]).astype(int)
    if bottom - top < 6 or right - left < 6:
        return None
    return int(top), int(left), int(bottom - top), int(right - left)


def _pattern_points(warp: FloatArray, window: tuple[int, int, int, int]) -> GreyImage:
    """Pattern coordinates (x, y, 1) of the window's pixel centres, shape (3, pixels)."""
    top, left, rows, columns = window
    inverse = np.linalg.inv(warp)[:, :, None, None]
    x, y = np.arange(left, left + columns)[None, :], np.arange(top, top + rows)[:, None]
    points = (inverse[:, 0] * x + inverse[:, 1] * y + inverse[:, 2]).reshape(3, -1)
    return np.asarray(points / points[2], dtype=np.float32)


def _velocities(generators: FloatArray, points: GreyImage) -> tuple[GreyImage, GreyImage]:
    """How points (3, n) move with each generator (m, 3, 3): their speeds in x and y, both (m, n)."""
    by_part = generators.transpose(1, 0, 2).reshape(-1, 3).astype(np.float32) @ points
    x, y, w = by_part.reshape(3, len(generators), -1)
    return x - w * points[0], y - w * points[1]


def _correlation(a: GreyImage, b: GreyImage) -> float:
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / scale if scale > 0 else 0.0
