"""Rigid poses: position and quaternion, as they travel, and 4×4 matrices, as they are computed with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """world_from_body: position (3,) in m, orientation a unit quaternion (x, y, z, w)."""

    position: Array
    orientation: Array

    @classmethod
    def from_matrix(cls, matrix: Array) -> Pose:
        """The pose of a 4×4 world_from_body."""
        return cls(matrix[:3, 3].copy(), quaternion(matrix[:3, :3]))

    def matrix(self) -> Array:
        """world_from_body, 4×4."""
        result = np.eye(4)
        result[:3, :3] = rotation(self.orientation)
        result[:3, 3] = self.position
        return result


def rotation(orientation: Array) -> Array:
    """The rotation matrix (3,3) of a unit quaternion (x, y, z, w)."""
    x, y, z, w = orientation
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion(matrix: Array) -> Array:
    """The unit quaternion (x, y, z, w) with w ≥ 0 of a rotation matrix (3,3).

    It is the eigenvector of the greatest eigenvalue of a symmetric matrix (I. Y. Bar-Itzhack 2000), which is stable for
    every rotation.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix
    symmetric = np.array(
        [
            [xx - yy - zz, yx + xy, zx + xz, zy - yz],
            [yx + xy, yy - xx - zz, zy + yz, xz - zx],
            [zx + xz, zy + yz, zz - xx - yy, yx - xy],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    vector: Array = np.linalg.eigh(symmetric)[1][:, -1]
    return -vector if vector[3] < 0 else vector
