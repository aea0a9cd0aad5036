"""Pictures, and windows: parts of a picture in which something is looked for."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
"""Colour picture, shape (rows, columns, 3), red green blue."""


@dataclass(frozen=True, slots=True)
class Window:
    """Where a thing's reference point may lie: from (top, left) up to but without (bottom, right), in whole px.

    The thing itself may reach beyond: whoever searches looks at as much more of the picture as the thing takes.
    """

    top: int
    left: int
    bottom: int
    right: int

    @classmethod
    def around(cls, row: float, column: float, reach: float, shape: tuple[int, ...]) -> Window | None:
        """The part of a picture of `shape` (rows, columns, …) that is at most `reach` px from a point along each axis.

        None when the picture has no such part.
        """
        top, left = (max(0, math.floor(value - reach)) for value in (row, column))
        bottom = min(shape[0], math.ceil(row + reach) + 1)
        right = min(shape[1], math.ceil(column + reach) + 1)
        return cls(top, left, bottom, right) if top < bottom and left < right else None

    @classmethod
    def whole(cls, shape: tuple[int, ...]) -> Window:
        """All of a picture of `shape` (rows, columns, …)."""
        return cls(0, 0, shape[0], shape[1])

    def grown(self, margin: int, shape: tuple[int, ...]) -> Window:
        """With `margin` px more on each side, as far as a picture of `shape` reaches."""
        return Window(
            max(0, self.top - margin),
            max(0, self.left - margin),
            min(shape[0], self.bottom + margin),
            min(shape[1], self.right + margin),
        )

    def of(self, image: Image) -> Image:
        """The part of a picture that lies in it."""
        return image[self.top : self.bottom, self.left : self.right]

    def holds(self, row: float, column: float) -> bool:
        """Whether a point lies in it."""
        return self.top <= row < self.bottom and self.left <= column < self.right
