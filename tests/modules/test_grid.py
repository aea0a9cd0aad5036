"""The grid's intersections on drawn pictures whose truth is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from handeye.modules.grid import see_grid
from handeye.modules.recognition import NotSeen

ROWS, COLUMNS, PITCH = 6, 9, 40
SCALE = 4  # drawn larger, then reduced: edges are smooth


def drawn(turn: float, at: tuple[float, float], size: float = 1.0) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """A picture of a board turned by `turn` rad with its middle at (row, column), and its corners (6, 9, 2)."""
    board = np.full(((ROWS + 3) * PITCH, (COLUMNS + 3) * PITCH), 255, np.uint8)
    for i in range(ROWS + 1):
        for j in range(COLUMNS + 1):
            if (i + j) % 2:
                board[(i + 1) * PITCH : (i + 2) * PITCH, (j + 1) * PITCH : (j + 2) * PITCH] = 0
    corners = np.stack(np.meshgrid(np.arange(COLUMNS) + 2, np.arange(ROWS) + 2), -1) * PITCH - 0.5  # (x, y)
    c, s = size * 0.5 * np.cos(turn), size * 0.5 * np.sin(turn)
    linear = np.array([[c, -s], [s, c]])
    middle = np.array([board.shape[1], board.shape[0]]) / 2 - 0.5
    offset = np.array([at[1], at[0]]) - linear @ middle
    large = np.column_stack([SCALE * linear, SCALE * offset + (SCALE - 1) / 2])
    picture = cv2.warpAffine(board, large, (640 * SCALE, 480 * SCALE), borderValue=200.0)
    small = cv2.resize(picture, (640, 480), interpolation=cv2.INTER_AREA)
    places = (corners @ linear.T + offset)[..., ::-1]
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_GRAY2RGB), np.uint8), places


@pytest.mark.parametrize("turn", [0.0, 0.1, -0.3, 0.6, -0.6])
def test_every_intersection_in_the_order_in_which_it_is_read(turn: float) -> None:
    left, in_left = drawn(turn, (240.0, 360.0))
    right, in_right = drawn(turn, (241.0, 230.0))
    seen = see_grid(left, right, ROWS, COLUMNS)
    assert seen.shape == (ROWS, COLUMNS, 3)
    # The drawing itself is good to a tenth of a pixel; on the lab's pictures it is 0.02 px.
    assert rms(seen[..., :2] - in_left) < 0.15
    assert rms(seen[..., 2] - (in_left[..., 1] - in_right[..., 1])) < 0.2


def rms(errors: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def test_a_board_that_is_cut_is_not_seen() -> None:
    left, _ = drawn(0.1, (240.0, 360.0))
    right, _ = drawn(0.1, (240.0, 20.0))
    with pytest.raises(NotSeen, match="right picture"):
        see_grid(left, right, ROWS, COLUMNS)
    with pytest.raises(NotSeen, match="left picture"):
        see_grid(np.zeros_like(left), left, ROWS, COLUMNS)


def test_two_boards_are_not_one() -> None:
    left, _ = drawn(0.1, (240.0, 360.0))
    right, _ = drawn(0.1, (200.0, 260.0))
    with pytest.raises(NotSeen, match="not the same"):
        see_grid(left, right, ROWS, COLUMNS)
