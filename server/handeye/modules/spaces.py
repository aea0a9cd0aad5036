"""The spaces on the way of the data, one frozen dataclass each.

Pictures are I; what recognition finds in them are points in the stereo image. The short way goes from a vector between
two such points to a difference of joint angles; the long way goes over a point in the camera's frame and one in the
arm's. Rows and columns are counted in px from the centre of the top left pixel; disparity = left column - right column.
`array()` gives a space's components as float64 in the order of its fields.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ROW_TOLERANCE = 6.0
"""How far the rows of one point may differ between left and right picture, in px."""


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
class HandPoint(ImagePoint):
    """The hand's point, and how the hand is turned: its outline's four corners in the stereo image, px.

    Each is (row, column, disparity); top left, top right, bottom right, bottom left, as the marker is read.
    """

    outline: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True, slots=True)
class ImagePair:
    """I, what recognition makes of a stereo pair: dimension 6, px, frame: the stereo image.

    The object's point and the hand's, a `HandPoint` where its outline was seen too; the confidences in [0, 1] say how
    sure the recognition is of each.
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
class HandVector:
    """I' for module IJS, the way from hand to object in the hand's own axes: dimension 3, m.

    To the right of the marker as it is read, up, and out of it.
    """

    vector: Floats
    support: float = 1.0
    """The least of the support of CSS's answers that it comes from, in [0, 1]."""

    def array(self) -> Floats:
        """(right, up, out), shape (3,)."""
        return np.asarray(self.vector, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class HeadAngles:
    """T, where the head points: dimension 2, rad, pan positive to its left and tilt positive upwards."""

    pan: float
    tilt: float

    def array(self) -> Floats:
        """(pan, tilt), shape (2,)."""
        return np.array([self.pan, self.tilt], dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class CameraPoint:
    """C, a point in space: (x, y, z), dimension 3, m, frame: the left camera's (x right, y down, z forward)."""

    position: Floats

    def array(self) -> Floats:
        """(x, y, z), shape (3,)."""
        return np.asarray(self.position, dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class ArmPoint:
    """A, where the arm's point has to be for the hand to be seen at a place: (x, y, z), dimension 3, m, frame: the arm.

    The arm's point is what the robot makes of its joint readings (`RobotState.point`), between the fingers; the hand is
    seen by another point, at its back. CAS learns one from the other, so nobody has to measure the way between them.
    """

    position: Floats

    def array(self) -> Floats:
        """(x, y, z), shape (3,)."""
        return np.asarray(self.position, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class HeadTurn:
    """S, how far the head is to turn so that a point comes to the middle of the left picture: dimension 2, rad."""

    pan: float
    tilt: float


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
