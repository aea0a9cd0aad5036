"""What an object looks like, learned from a few pictures without it and a few with it, and where it is in others.

The silhouette is correlated with the picture's probability map, then aligned to a fraction of a pixel. What is partly
hidden in one of two pictures has its size from the other one. Nothing here knows any object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from handeye.modules.alignment import FloatArray, Pattern
from handeye.modules.object_learning import median_silhouette, object_mask, probability_table
from handeye.modules.silhouette import MARGIN, Template, lab_bins, rough_places, templates, upright
from handeye.modules.silhouette_fit import PLACE, WHOLE, Steps, fit, probability_map
from handeye.modules.spaces import ROW_TOLERANCE
from handeye.modules.window import Image, Window

_OUT_OF_PROPORTION = 0.03  # logarithm of width by height beyond what the examples had
_SMALLER = 0.05  # logarithm of a size to that in the other picture
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
        masks = [object_mask(example, backgrounds, number) for number, example in enumerate(examples, 1)]
        table = probability_table(backgrounds, examples, masks)
        silhouette, sizes = median_silhouette([probability_map(example, table) for example in examples], masks)
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
            self._refine(image, upright(seen.row + side * down, seen.column + side * across, half), PLACE)
            for side in (-1.0, 0.0, 1.0)
        ]
        likely = [each for each in places if each is not None and abs(each.row - other.row) < ROW_TOLERANCE]
        return max(likely, key=lambda each: each.score, default=seen)

    def likeness(self, image: Image) -> NDArray[np.uint8]:
        """How probably each pixel shows the object, 0…255: a grey picture of the same (rows, columns)."""
        return np.asarray(np.rint(255 * self.object_probability.ravel()[lab_bins(image)]), dtype=np.uint8)

    def _refine(self, image: Image, start: FloatArray, steps: Steps = WHOLE) -> Sighting | None:
        """The object near the warp `start`, or None when what is there has another shape."""
        rows, columns = 1.4 * start[1, 1], 1.4 * start[0, 0]
        top, left = max(0, int(start[1, 2] - rows)), max(0, int(start[0, 2] - columns))
        height, width = (2 * int(value) for value in (rows, columns))
        window = image[top : top + height, left : left + width]
        window = window[: window.shape[0] // 2 * 2, : window.shape[1] // 2 * 2]
        offset = np.array([[0, 0, left], [0, 0, top], [0, 0, 0.0]])
        seen = probability_map(window, self.object_probability)
        found = fit(seen, self.silhouette, start - offset, steps)
        if found is None or found.correlation < _MIN_CORRELATION:
            return None
        sighting = _sighting(found.image_from_pattern + offset, found.correlation, image.shape)
        return sighting if self._plausible(sighting) else None

    def _plausible(self, sighting: Sighting) -> bool:
        size = np.array(sighting.size)
        smallest, largest = self.sizes.min(axis=0), self.sizes.max(axis=0)
        return bool((size > smallest / _SIZE_TOLERANCE).all() and (size < largest * _SIZE_TOLERANCE).all())


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
