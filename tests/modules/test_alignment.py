"""Alignment of a pattern that leans: the motion that steps take longest to."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from handeye.modules.alignment import UPRIGHT, Alignment, Pattern, align, predict

SIZE = 96
OUTLIER = 0.2
START = np.array([[25.0, 0.0, 60.0], [0.0, 35.0, 60.0], [0.0, 0.0, 1.0]])


def silhouette(top: int) -> Pattern:
    """A cup whose rim is so many px narrower on either side than its foot."""
    shape = np.zeros((SIZE, SIZE), np.float32)
    corners = [[14 + top, 14], [SIZE - 15 - top, 14], [SIZE - 15, SIZE - 15], [14, SIZE - 15]]
    cv2.fillPoly(shape, [np.array(corners)], 1.0)
    return Pattern.of(np.asarray(cv2.GaussianBlur(shape, (0, 0), 2.0), dtype=np.float32))


def aligned(picture: NDArray[np.float32], iterations: int) -> Alignment:
    found = align(picture, silhouette(0), START, UPRIGHT, outlier=OUTLIER, iterations=iterations)
    assert found is not None
    return found


@pytest.mark.parametrize("lean", [-0.1, -0.05, 0.07])
def test_a_leaning_thing_that_has_not_quite_the_shape_is_aligned_in_few_steps(lean: float) -> None:
    there = START @ np.array([[1.03, lean, 0.05], [0.0, 0.98, -0.03], [0.0, 0.0, 1.0]])
    picture = predict(silhouette(6), there, (0, 0, 120, 120), subsamples=4)[..., 0]
    assert aligned(picture, 8).image_from_pattern == pytest.approx(aligned(picture, 60).image_from_pattern, abs=0.1)
    assert aligned(picture, 60).centre == pytest.approx(there[1::-1, 2], abs=0.5)
