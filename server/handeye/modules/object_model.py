"""What an object looks like, learned from a few pictures without it and a few with it.

Learning: the object is where an example differs from its background. Its colours against all other colours give each
pixel's probability of showing the object: Bayes' rule over smoothed Lab histograms (Jones and Rehg, "Statistical Color
Models", IJCV 2002). The median of these probability maps over the examples is its silhouette: what sticks out to
another side in every example, as a mug's handle does, is not in it.
Locating: the silhouette is correlated with the picture's probability map, then aligned to a fraction of a pixel. What
is partly hidden in one of two pictures has its size from the other one.
Nothing here knows any object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
from handeye.modules.silhouette import BINS, MARGIN, Template, lab_bins, rough_places, templates, upright
from handeye.modules.spaces import ROW_TOLERANCE
from handeye.modules.window import Image, Window

_COLOUR_NOISE = 1.2  # bins: spread given to every registered colour
_STRANGE = 2e-6  # density of colours never seen, per bin: anything not registered counts as something else
_PATTERN_SIZE = 96
_Steps = tuple[tuple[tuple[FloatArray, ...], float], tuple[tuple[FloatArray, ...], float]]
"""A rough and a fine alignment: what is free, and the probability residual of a pixel that is half distrusted."""
_ALL: _Steps = (SHIFT_AND_SCALE, 0.35), (UPRIGHT, 0.2)
"""Shift and size alone first, so that a handle or a neighbour does not stretch the silhouette; then lean and width."""
_PLACE: _Steps = (SHIFT, 0.2), (SHIFT, 0.05)
_ROUGHLY = 0.01  # half sizes: near enough for the fine alignment to begin from
_OUT_OF_PROPORTION = 0.03  # logarithm of width by height beyond what the examples had
_SMALLER = 0.05  # logarithm of a size to that in the other picture
_HALVED_FROM_FULL = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1.0]])  # pixel centres of a halved picture
_CHANGE = (4.0, 12.0)  # difference in Lab that counts as new: five times the noise, within these bounds
_DISC = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
_MIN_AREA = 80  # px
_MAX_AREA_PART = 0.2  # of the picture
_SIZE_TOLERANCE = 1.3  # beyond the sizes of the examples
_SURE = 0.95  # correlation of a thing in full view
_MIN_CORRELATION = 0.75  # with the silhouette; a cup half hidden by a finger has 0.8


@dataclass(frozen=True, slots=True)
class Sighting:
    """One place that looks like the object.

    Reference point (row, column) in px: the silhouette's centre. `size`: half height and half width in px. `score`:
    correlation with the silhouette, 0…1. `cut`: the picture's border cuts the object.
    """

    row: float
    column: float
    size: tuple[float, float]
    score: float
    cut: bool


@dataclass(frozen=True, slots=True, eq=False)
class ObjectModel:
    """A registered object: colours, silhouette and sizes."""

    object_probability: NDArray[np.float32]
    """Probability that a pixel of a Lab bin shows the object, shape (64, 64, 64)."""
    silhouette: Pattern
    """Median probability map of the examples over the object's box and a margin."""
    sizes: FloatArray
    """Half height and half width in px at each example, shape (examples, 2)."""
    templates: tuple[Template, ...]
    """The silhouette at the sizes that are searched for."""

    @classmethod
    def learn(cls, backgrounds: Sequence[Image], examples: Sequence[Image]) -> ObjectModel:
        """Learns from pictures without (`backgrounds`) and with the object (`examples`).

        Pictures of left and right camera may be mixed: each example is compared with the background most like it.
        ValueError, saying what to do, when there are no pictures, or an example shows nothing new, too much new, or
        an object cut by the border.
        """
        if not backgrounds or not examples:
            raise ValueError("an object is learned from at least one picture without it and one picture with it")
        if len({image.shape for image in (*backgrounds, *examples)}) != 1:
            raise ValueError("all pictures of an object must have the same size")
        masks = [_object_mask(example, backgrounds, number) for number, example in enumerate(examples, 1)]
        table = _probability_table(backgrounds, examples, masks)
        maps = [probability_map(example, table) for example in examples]
        silhouette, sizes = _silhouette(maps, masks)
        return cls(table, silhouette, sizes, templates(silhouette, sizes))

    def locate(self, image: Image, window: Window | None = None) -> list[Sighting]:
        """All places in `image`, or in a window of it, that look like the object, best first; empty when there is none.

        In a window the answer is that of the whole picture, except that likenesses beyond it are not known.
        """
        searched = Window.whole(image.shape) if window is None else window
        found: list[Sighting] = []
        for start in rough_places(image, self.object_probability, self.templates, searched):
            if any(_is_of(start, other) for other in found):
                continue
            sighting = self._refine(image, start)
            if sighting is not None and not any(_same(sighting, other) for other in found):
                found.append(sighting)
        return sorted(found, key=lambda sighting: -sighting.score)

    def completed(self, image: Image, seen: Sighting, other: Sighting) -> Sighting:
        """`seen` in `image`, found anew when a part of it is hidden; `other` is the same thing in the other picture.

        A thing has nearly the same size to both eyes. What is narrower or lower than there, and out of proportion, is
        hidden in part, and its middle is not where it seems: what is seen of it is fitted in the other one's size.
        """
        taller, wider = np.log(np.divide(seen.size, other.size))
        proportions = np.log(self.sizes[:, 1] / self.sizes[:, 0])
        proportion = np.log(seen.size[1] / seen.size[0])
        narrow = wider < -_SMALLER and proportion < proportions.min() - _OUT_OF_PROPORTION
        low = taller < -_SMALLER and proportion > proportions.max() + _OUT_OF_PROPORTION
        if not narrow and not low:
            return seen
        # What hides it may be on either side, or before its middle.
        down, across = np.subtract(other.size, seen.size) * (low, narrow)
        half = np.array(other.size) * MARGIN
        places = [
            self._refine(image, upright(seen.row + side * down, seen.column + side * across, half), _PLACE)
            for side in (-1.0, 0.0, 1.0)
        ]
        likely = [each for each in places if each is not None and abs(each.row - other.row) < ROW_TOLERANCE]
        return max(likely, key=lambda each: each.score, default=seen)

    def likeness(self, image: Image) -> NDArray[np.uint8]:
        """How probably each pixel shows the object, 0…255: a grey picture of the same (rows, columns)."""
        return np.asarray(np.rint(255 * self.object_probability.ravel()[lab_bins(image)]), dtype=np.uint8)

    def _refine(self, image: Image, start: FloatArray, steps: _Steps = _ALL) -> Sighting | None:
        """The object near the warp `start`, or None when what is there has another shape."""
        rows, columns = 1.4 * start[1, 1], 1.4 * start[0, 0]
        top, left = max(0, int(start[1, 2] - rows)), max(0, int(start[0, 2] - columns))
        height, width = (2 * int(value) for value in (rows, columns))
        window = image[top : top + height, left : left + width]
        window = window[: window.shape[0] // 2 * 2, : window.shape[1] // 2 * 2]
        offset = np.array([[0, 0, left], [0, 0, top], [0, 0, 0.0]])
        seen = probability_map(window, self.object_probability)
        fit = _fit(seen, self.silhouette, start - offset, steps)
        if fit is None or fit.correlation < _MIN_CORRELATION:
            return None
        sighting = _sighting(fit.image_from_pattern + offset, fit.correlation, image.shape)
        return sighting if self._plausible(sighting) else None

    def _plausible(self, sighting: Sighting) -> bool:
        size = np.array(sighting.size)
        smallest, largest = self.sizes.min(axis=0), self.sizes.max(axis=0)
        return bool((size > smallest / _SIZE_TOLERANCE).all() and (size < largest * _SIZE_TOLERANCE).all())


def probability_map(image: Image, table: NDArray[np.float32]) -> GreyImage:
    """Each pixel's probability of showing the object, lightly smoothed; shape (rows, columns)."""
    seen = table.ravel()[lab_bins(image)]
    return np.asarray(cv2.GaussianBlur(seen, (0, 0), 1.0), dtype=np.float32)


def _object_mask(example: Image, backgrounds: Sequence[Image], number: int) -> NDArray[np.bool_]:
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


def _probability_table(
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


def _fit(seen: GreyImage, silhouette: Pattern, start: FloatArray, steps: _Steps = _ALL) -> Alignment | None:
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


def _silhouette(maps: Sequence[GreyImage], masks: Sequence[NDArray[np.bool_]]) -> tuple[Pattern, FloatArray]:
    """The examples' median probability map, each one aligned with it, and the objects' sizes in px."""
    warps = [_box_warp(mask) for mask in masks]
    ratio = np.median([warp[0, 0] / warp[1, 1] for warp in warps])
    for warp in warps:
        warp[0, 0] = warp[1, 1] * ratio
    pattern = _median_pattern(maps, warps)
    for _ in range(3):
        fits = [_fit(seen, pattern, warp) for seen, warp in zip(maps, warps, strict=True)]
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


def _sighting(warp: FloatArray, score: float, shape: tuple[int, ...]) -> Sighting:
    column, row = (float(value) for value in warp[:2, 2])
    half_columns, half_rows = warp[0, 0] / MARGIN, warp[1, 1] / MARGIN
    cut = (
        row - half_rows < 0
        or column - half_columns < 0
        or row + half_rows > shape[0] - 1
        or column + half_columns > shape[1] - 1
    )
    return Sighting(row, column, (float(half_rows), float(half_columns)), score, bool(cut))


def _is_of(start: FloatArray, found: Sighting) -> bool:
    """Whether a rough place lies within what was found well: another size of the same thing."""
    away = np.abs(start[[1, 0], 2] - (found.row, found.column))
    return found.score > _SURE and bool((away < found.size).all())


def _same(a: Sighting, b: Sighting) -> bool:
    return abs(a.row - b.row) < a.size[0] / 2 and abs(a.column - b.column) < a.size[1] / 2
