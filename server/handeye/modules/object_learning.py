"""Learning what an object looks like, from a few pictures without it and a few with it.

The object is where an example differs from its background. Its colours against all other colours give each pixel's
probability of showing the object: Bayes' rule over smoothed Lab histograms (Jones and Rehg, "Statistical Color Models",
IJCV 2002). The median of these probability maps over the examples is its silhouette: what sticks out to another side in
every example, as a mug's handle does, is not in it.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from handeye.modules.alignment import FloatArray, GreyImage, Pattern
from handeye.modules.silhouette import BINS, MARGIN, lab_bins, upright
from handeye.modules.silhouette_fit import WHOLE, fit
from handeye.modules.window import Image

_COLOUR_NOISE = 1.2  # bins: spread given to every registered colour
_STRANGE = 2e-6  # density of colours never seen, per bin: anything not registered counts as something else
_PATTERN_SIZE = 96
_CHANGE = (4.0, 12.0)  # difference in Lab that counts as new: five times the noise, within these bounds
_DISC = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
_MIN_AREA = 80  # px
_MAX_AREA_PART = 0.2  # of the picture


def object_mask(example: Image, backgrounds: Sequence[Image], number: int) -> NDArray[np.bool_]:
    """Where `example` shows something that the background most like it does not."""
    differences = [_difference(example, background) for background in backgrounds]
    difference = min(differences, key=lambda d: float(np.minimum(d, 20.0).mean()))
    changed = (difference > np.clip(5.0 * np.median(difference), *_CHANGE)).astype(np.uint8)
    solid = cv2.morphologyEx(changed, cv2.MORPH_OPEN, _DISC)
    solid = cv2.morphologyEx(solid, cv2.MORPH_CLOSE, _DISC, iterations=2)
    contours, _ = cv2.findContours(solid, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    advice = (
        f"example {number}: put the object alone into full view of both cameras, leave all else as in the background"
    )
    largest = max(contours, key=cv2.contourArea, default=None)
    if largest is None or cv2.contourArea(largest) < _MIN_AREA:
        raise ValueError(f"{advice}; nothing of at least {_MIN_AREA} px differs from the background")
    if cv2.contourArea(largest) > _MAX_AREA_PART * changed.size:
        raise ValueError(f"{advice}; more than a fifth of the picture differs from every background")
    mask = np.zeros_like(changed)
    cv2.drawContours(mask, [largest], -1, 1, cv2.FILLED)
    column, row, width, height = cv2.boundingRect(largest)
    if min(row, column) <= 1 or row + height >= mask.shape[0] - 1 or column + width >= mask.shape[1] - 1:
        raise ValueError(f"{advice}; it is cut by the picture's border")
    return _to_half_level(mask, difference)


def _to_half_level(mask: NDArray[np.uint8], difference: FloatArray) -> NDArray[np.bool_]:
    """Without the rim where the object covers less than half of a pixel.

    There the difference from the background has fallen below half of that a little further in.
    """
    core = cv2.erode(mask, _DISC, iterations=2)
    plateau = cv2.dilate(difference * core, _DISC, iterations=4)
    return np.asarray((mask > 0) & ((difference > plateau / 2) | (core > 0)), dtype=np.bool_)


def _difference(a: Image, b: Image) -> FloatArray:
    """Distance in Lab per pixel, of smoothed pictures."""
    lab = [
        cv2.cvtColor(cv2.GaussianBlur(image, (0, 0), 1.0).astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
        for image in (a, b)
    ]
    return np.asarray(np.linalg.norm(lab[0] - lab[1], axis=2), dtype=np.float64)


def probability_table(
    backgrounds: Sequence[Image], examples: Sequence[Image], masks: Sequence[NDArray[np.bool_]]
) -> NDArray[np.float32]:
    """Probability of the object for each Lab bin, with even odds beforehand."""
    everywhere = [np.ones(image.shape[:2], bool) for image in backgrounds]
    of_object = _histogram(examples, masks)
    of_others = _histogram([*examples, *backgrounds], [*(~mask for mask in masks), *everywhere])
    return (of_object / (of_object + of_others + _STRANGE)).astype(np.float32)


def _histogram(images: Sequence[Image], masks: Sequence[NDArray[np.bool_]]) -> FloatArray:
    """Density over Lab bins of the masked pixels, smoothed."""
    counts = np.zeros(BINS**3)
    for image, mask in zip(images, masks, strict=True):
        counts += np.bincount(lab_bins(image)[mask], minlength=BINS**3)
    density = (counts / max(counts.sum(), 1.0)).reshape(BINS, BINS, BINS)
    for _ in range(3):  # one axis after the other: turn the cube, smooth along what is now its last axis
        density = np.moveaxis(density, 0, -1)
        flat = cv2.GaussianBlur(np.ascontiguousarray(density).reshape(-1, BINS), (11, 1), _COLOUR_NOISE)
        density = np.asarray(flat, dtype=np.float64).reshape(density.shape)
    return np.asarray(density, dtype=np.float64)


def median_silhouette(maps: Sequence[GreyImage], masks: Sequence[NDArray[np.bool_]]) -> tuple[Pattern, FloatArray]:
    """The examples' median probability map, each one aligned with it, and the objects' sizes in px."""
    warps = [_box_warp(mask) for mask in masks]
    ratio = np.median([warp[0, 0] / warp[1, 1] for warp in warps])
    for warp in warps:
        warp[0, 0] = warp[1, 1] * ratio
    pattern = _median_pattern(maps, warps)
    for _ in range(3):
        fits = [fit(seen, pattern, warp, WHOLE) for seen, warp in zip(maps, warps, strict=True)]
        warps = [warp if fit is None else fit.image_from_pattern for fit, warp in zip(fits, warps, strict=True)]
        pattern = _median_pattern(maps, warps)
    sizes = np.array([[warp[1, 1] / MARGIN, warp[0, 0] / MARGIN] for warp in warps])
    return pattern, sizes


def _median_pattern(maps: Sequence[GreyImage], warps: Sequence[FloatArray]) -> Pattern:
    size = (_PATTERN_SIZE, _PATTERN_SIZE)
    blank = Pattern.of(np.zeros(size, np.float32))
    cut_out = [
        cv2.warpPerspective(
            seen, warp @ np.linalg.inv(blank.pixels_from_units), size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        )
        for seen, warp in zip(maps, warps, strict=True)
    ]
    return Pattern.of(np.median(cut_out, axis=0))


def _box_warp(mask: NDArray[np.bool_]) -> FloatArray:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    half = np.array([rows[-1] - rows[0] + 1, columns[-1] - columns[0] + 1]) / 2
    return upright((rows[0] + rows[-1]) / 2, (columns[0] + columns[-1]) / 2, half * MARGIN)
