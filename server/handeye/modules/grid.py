"""Finding a grid target's intersections in both pictures, to about 0.02 px; part of RSS, for collecting only."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from handeye.modules.recognition import NotSeen
from handeye.modules.spaces import ROW_TOLERANCE
from handeye.modules.window import Image

Corners = NDArray[np.float64]

_FLAGS = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE


def see_grid(left: Image, right: Image, rows: int, columns: int) -> Corners:
    """The intersections of a chessboard in a stereo pair, (rows, columns, 3) as (row, column, disparity) in px.

    Row by row, the first one at the upper left, for a board that is rolled by less than 45 degrees. `NotSeen` when the
    board is not whole in both pictures.
    """
    in_left, in_right = _corners(left, rows, columns, "left"), _corners(right, rows, columns, "right")
    if np.abs(in_left[..., 0] - in_right[..., 0]).max() > ROW_TOLERANCE:
        raise NotSeen("the grid is not seen: what looks like it in the two pictures is not the same thing")
    return np.stack([in_left[..., 0], in_left[..., 1], in_left[..., 1] - in_right[..., 1]], axis=-1)


def _corners(image: Image, rows: int, columns: int, picture: str) -> Corners:
    """(rows, columns, 2) as (row, column)."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    found, corners = cv2.findChessboardCornersSB(grey, (columns, rows), flags=_FLAGS)
    if not found:
        raise NotSeen(
            f"the grid is not seen in the {picture} picture: the whole board of {rows} x {columns} intersections must "
            "be in view, lit evenly and not too oblique"
        )
    grid = np.asarray(corners, np.float64).reshape(rows, columns, 2)[..., ::-1]
    if rows == columns and abs(grid[0, -1, 0] - grid[0, 0, 0]) > abs(grid[0, -1, 1] - grid[0, 0, 1]):
        grid = grid.transpose(1, 0, 2)  # it was read by columns
    if grid[0, 0, 0] > grid[-1, 0, 0]:
        grid = grid[::-1]
    if grid[0, 0, 1] > grid[0, -1, 1]:
        grid = grid[:, ::-1]
    return grid
