"""The spaces on the way of the data, one frozen dataclass each.

Pictures are I; what recognition finds in them are points in the stereo image; the action is a vector between two such
points; the answer is a difference of joint angles. Rows and columns are counted in px from the centre of the top left
pixel; disparity = left column - right column. `array()` gives a space's components as float64 in the order of its
fields.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ImagePoint:
    """A point seen by both cameras: dimension 3, px, frame: the stereo image (row and column in the left one)."""

    row: float
    column: float
    disparity: float

    def array(self) -> Floats:
        """(row, column, disparity), shape (3,)."""
        return np.array([self.row, self.column, self.disparity], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class ImagePair:
    """I, what recognition makes of a stereo pair: dimension 6, px, frame: the stereo image.

    The object's point and the hand's; the confidences in [0, 1] say how sure the recognition is of each.
    """

    object: ImagePoint
    hand: ImagePoint
    object_confidence: float = 1.0
    hand_confidence: float = 1.0


@dataclass(frozen=True, slots=True)
class ImageVector:
    """I' for module IJS, the way from hand to object: dimension 3, px, a difference in the stereo image."""

    rows: float
    columns: float
    disparity: float

    def array(self) -> Floats:
        """(delta row, delta column, delta disparity), shape (3,)."""
        return np.array([self.rows, self.columns, self.disparity], dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class JointAngles:
    """theta, the posture of the arm: one angle for each joint (PUMA: 6), rad, frame: the joints, base to wrist."""

    angles: Floats

    def array(self) -> Floats:
        """The angles, shape (joints,)."""
        return np.asarray(self.angles, dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class JointDifference:
    """Delta theta, how far each joint is to turn: one angle for each joint, rad, frame: the joints, base to wrist."""

    angles: Floats

    def array(self) -> Floats:
        """The differences, shape (joints,)."""
        return np.asarray(self.angles, dtype=np.float64)
