"""The rough search for an object: where in a picture, or in a window of it, the probability map has its silhouette.

The map is reduced, and correlated with the silhouette at a few sizes. In a window the same cells of the same reduced
map are correlated with the same templates as in the whole picture, so what is found there begins from the same place.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from handeye.modules.alignment import FloatArray, GreyImage, Pattern, predict
from handeye.modules.window import Image, Window

MARGIN = 1.4
"""The silhouette pattern reaches this far beyond the object, in half sizes."""

BINS = 64
"""Bins per Lab channel."""
_COARSE = 4  # the search runs on the probability map reduced by this
_MIN_RESPONSE = 0.35  # the object in full view gives 1
_RIVAL = 0.6  # of the best response: less is not worth a closer look
_MAX_CANDIDATES = 4
_RIM = 1  # cells around a window that are searched too: what is highest there belongs to something beyond


@dataclass(frozen=True, slots=True, eq=False)
class Template:
    """The silhouette at one size on the coarse grid, with mean 0 and response 1 to itself.

    `half`: the object's half height and half width in px.
    """

    half: FloatArray
    shown: GreyImage

    @classmethod
    def of(cls, silhouette: Pattern, half: FloatArray) -> Template:
        """The silhouette of an object with these half sizes."""
        reach = half * MARGIN / _COARSE
        rows, columns = (2 * int(np.ceil(value)) + 1 for value in reach)
        middle = upright((rows - 1) / 2, (columns - 1) / 2, reach)
        shown = predict(silhouette, middle, (0, 0, rows, columns), subsamples=4)[..., 0]
        template = shown - shown.mean()
        return cls(half, np.asarray(template / max(float((template * shown).sum()), 1e-9), dtype=np.float32))


def templates(silhouette: Pattern, sizes: FloatArray) -> tuple[Template, ...]:
    """The sizes that are searched for, from the examples' half heights and half widths in px, (examples, 2)."""
    middle = np.exp(np.log(sizes).mean(axis=0))
    smallest, largest = (float(np.sqrt(limit)) for limit in ((sizes / middle).min(), (sizes / middle).max()))
    return tuple(Template.of(silhouette, middle * scale) for scale in (0.93 * smallest, 1.07 * largest))


def upright(row: float, column: float, half: FloatArray) -> FloatArray:
    """image_from_pattern of an upright pattern with half height and half width `half` in px."""
    return np.array([[half[1], 0, column], [0, half[0], row], [0, 0, 1.0]])


def lab_bins(image: Image) -> NDArray[np.int32]:
    """The number of each pixel's bin in a table over Lab of shape (64, 64, 64); shape (rows, columns)."""
    lab = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2LAB), dtype=np.uint8) // np.uint8(256 // BINS)
    numbers = lab.astype(np.int32) @ np.array([BINS * BINS, BINS, 1], np.int32)
    return np.asarray(numbers, dtype=np.int32)


def rough_places(
    image: Image, table: NDArray[np.float32], sizes: tuple[Template, ...], window: Window
) -> list[FloatArray]:
    """Rough warps image_from_pattern, best first: peaks of the correlation with the templates within `window`.

    `table`: each Lab bin's probability of showing the object, shape (64, 64, 64).
    """
    rows, columns = grid = _grid(image)
    top, bottom = window.top // _COARSE, min(-(-window.bottom // _COARSE), rows)
    left, right = window.left // _COARSE, min(-(-window.right // _COARSE), columns)
    if top >= bottom or left >= right:
        return []
    cells = Window(top, left, bottom, right)
    around = cells.grown(_RIM, grid)
    pad = max(each.shown.shape[0] for each in sizes) // 2, max(each.shown.shape[1] for each in sizes) // 2
    coarse = _coarse_map(image, table, around, pad)
    peaks: list[tuple[float, FloatArray]] = []
    for template in sizes:
        height, width = template.shown.shape
        above, before = pad[0] - height // 2, pad[1] - width // 2
        part = coarse[above : coarse.shape[0] - above, before : coarse.shape[1] - before]
        response = np.asarray(cv2.matchTemplate(part, template.shown, cv2.TM_CCORR), dtype=np.float32)
        for row, column, level in _peaks(response, template.half / _COARSE):
            cell = row + around.top, column + around.left
            if cells.holds(*cell):
                down, across = ((each + 0.5) * _COARSE - 0.5 for each in cell)
                peaks.append((level, upright(down, across, template.half * MARGIN)))
    return _distinct(peaks)


def _grid(image: Image) -> tuple[int, int]:
    """How many (rows, columns) of cells the reduced map has."""
    return image.shape[0] // _COARSE, image.shape[1] // _COARSE


def _coarse_map(image: Image, table: NDArray[np.float32], cells: Window, pad: tuple[int, int]) -> GreyImage:
    """The reduced map's `cells` and `pad` (rows, columns) more on each side; 0 where the picture does not reach."""
    rows, columns = _grid(image)
    top, bottom, left, right = cells.top - pad[0], cells.bottom + pad[0], cells.left - pad[1], cells.right + pad[1]
    there = Window(max(0, top), max(0, left), min(rows, bottom), min(columns, right))
    size = there.right - there.left, there.bottom - there.top
    part = image[there.top * _COARSE : there.bottom * _COARSE, there.left * _COARSE : there.right * _COARSE]
    reduced = cv2.resize(part, size, interpolation=cv2.INTER_AREA)
    seen = table.ravel()[lab_bins(np.asarray(reduced, dtype=np.uint8))]
    borders = there.top - top, bottom - there.bottom, there.left - left, right - there.right
    return np.asarray(cv2.copyMakeBorder(seen, *borders, cv2.BORDER_CONSTANT, value=0.0), dtype=np.float32)


def _peaks(response: NDArray[np.float32], half: FloatArray) -> list[tuple[int, int, float]]:
    """(row, column, height) of the highest responses, at least about half an object apart."""
    remaining = response.copy()
    peaks = []
    for _ in range(_MAX_CANDIDATES):
        _, height, _, (column, row) = cv2.minMaxLoc(remaining)
        if height < _MIN_RESPONSE:
            break
        peaks.append((row, column, float(height)))
        rows, columns = (max(1, int(value)) for value in half)
        remaining[max(0, row - rows) : row + rows + 1, max(0, column - columns) : column + columns + 1] = -1.0
    return peaks


def _distinct(peaks: list[tuple[float, FloatArray]]) -> list[FloatArray]:
    """The warps of the highest peaks, best first, that are not the same place again at another size."""
    peaks = sorted(peaks, key=lambda peak: -peak[0])
    distinct: list[FloatArray] = []
    for height, warp in peaks:
        if height > _RIVAL * peaks[0][0] and not any(
            np.abs((warp - other)[:2, 2] / np.diag(other)[:2]).max() < 0.3 for other in distinct
        ):
            distinct.append(warp)
    return distinct[:_MAX_CANDIDATES]
