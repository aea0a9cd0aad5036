"""ASM, action specification: what of the seen things an action goes by (thesis 3.1, Fig 3.2).

In the picture it is the way from hand to object, as the thesis has it. What that way has to be where the hand is to
stop changes with the place, because hand and view turn, so it takes several demonstrations to learn. In the hand's own
axes it is the same everywhere: one demonstration says it all. The axes are seen too: the marker's outline, by way of
CSS.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from handeye.modules.module import Module
from handeye.modules.spaces import Floats, HandPoint, HandVector, ImagePair, ImageVector

Frame = Literal["picture", "hand"]
"""In which axes the way from hand to object is told."""


def in_picture(found: ImagePair) -> ImageVector:
    """The way from hand to object as a difference in the stereo image."""
    return ImageVector(
        rows=found.object.row - found.hand.row,
        columns=found.object.column - found.hand.column,
        disparity=found.object.disparity - found.hand.disparity,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Metric:
    """Object and hand of a look in the camera's frame, in m: the object's point (3,), the marker's middle (3,), and the
    hand's axes (3, 3) as columns: to the right, up and out of the marker; and the least support of CSS's answers."""

    object: Floats
    hand: Floats
    axes: Floats
    support: float

    @property
    def way(self) -> HandVector:
        """The way from hand to object in the hand's own axes."""
        return self.to(self.object)

    def to(self, point: Floats) -> HandVector:
        """The way from the hand to any point (3,)."""
        return HandVector(self.axes.T @ (point - self.hand), self.support)

    def at_end_of(self, way: HandVector) -> Floats:
        """The point (3,) that is so far from the hand, in its own axes."""
        point: Floats = self.hand + self.axes @ way.array()
        return point


def metric(css: Module, found: ImagePair) -> Metric:
    """A look by module CSS.

    `TypeError` when the hand was seen without its outline; `NotTaught` when CSS knows nothing.
    """
    if not isinstance(found.hand, HandPoint):
        raise TypeError("the hand was seen as a point only, without its outline")
    answers = css.answers(np.array([found.object.array(), *found.hand.outline]))
    centre, axes = _frame(answers.outputs[1:])
    return Metric(answers.outputs[0], centre, axes, float(answers.support.min()))


def in_hand(css: Module, found: ImagePair) -> HandVector:
    """The way from hand to object in the hand's own axes; raises as `metric` does."""
    return metric(css, found).way


def _frame(outline: Floats) -> tuple[Floats, Floats]:
    """Centre (3,) and axes (3, 3), as columns to the right, up and out of the hand, of its four corners (4, 3) in m.

    Corners are in the order top left, top right, bottom right, bottom left.
    """
    top_left, top_right, bottom_right, bottom_left = outline
    right = _unit(top_right + bottom_right - top_left - bottom_left)
    up = top_left + top_right - bottom_right - bottom_left
    up = _unit(up - right * (up @ right))
    return outline.mean(axis=0), np.column_stack([right, up, np.cross(right, up)])


def _unit(vector: Floats) -> Floats:
    unit: Floats = vector / np.linalg.norm(vector)
    return unit
