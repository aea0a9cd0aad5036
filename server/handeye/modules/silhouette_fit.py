"""The silhouette of an object, aligned to a fraction of a pixel with how probably each pixel shows that object."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from handeye.modules.alignment import (
    SHIFT,
    SHIFT_AND_SCALE,
    UPRIGHT,
    Alignment,
    FloatArray,
    GreyImage,
    Pattern,
    align,
)
from handeye.modules.silhouette import lab_bins
from handeye.modules.window import Image

Steps = tuple[tuple[tuple[FloatArray, ...], float], tuple[tuple[FloatArray, ...], float]]
"""A rough and a fine alignment: what is free, and the probability residual of a pixel that is half distrusted."""
WHOLE: Steps = (SHIFT_AND_SCALE, 0.35), (UPRIGHT, 0.2)
"""Shift and size alone first, so that a handle or a neighbour does not stretch the silhouette; then lean and width."""
PLACE: Steps = (SHIFT, 0.2), (SHIFT, 0.05)

_ROUGHLY = 0.01  # half sizes: near enough for the fine alignment to begin from
_HALVED_FROM_FULL = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1.0]])  # pixel centres of a halved picture


def probability_map(image: Image, table: NDArray[np.float32]) -> GreyImage:
    """Each pixel's probability of showing the object, lightly smoothed; shape (rows, columns)."""
    seen = table.ravel()[lab_bins(image)]
    return np.asarray(cv2.GaussianBlur(seen, (0, 0), 1.0), dtype=np.float32)


def fit(seen: GreyImage, silhouette: Pattern, start: FloatArray, steps: Steps) -> Alignment | None:
    """The silhouette aligned with the probability map `seen`, from the warp `start`.

    Works on the map halved: it is smooth, so this costs no accuracy and takes a quarter of the time.
    """
    halved = np.asarray(cv2.resize(seen, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), dtype=np.float32)
    (roughly_free, distrusted), (free, outlier) = steps
    start = _HALVED_FROM_FULL @ start
    rough = align(halved, silhouette, start, roughly_free, outlier=distrusted, converged=_ROUGHLY)
    if rough is None:
        return None
    fine = align(halved, silhouette, rough.image_from_pattern, free, outlier=outlier)
    return (
        None
        if fine is None
        else Alignment(np.linalg.inv(_HALVED_FROM_FULL) @ fine.image_from_pattern, fine.correlation)
    )
