"""Drawn pictures with known sub-pixel truth: antialiased shapes, a warped marker, sensor noise."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

SIZE = (240, 320)
TABLE: Colour = (205, 200, 190)
FINE = 8  # drawn points along a pixel


@dataclass(frozen=True)
class Thing:
    """Something upright at (row, column) px; `half`: half height and width; bands of one or more colours."""

    row: float
    column: float
    half: tuple[float, float]
    colours: tuple[Colour, ...]
    shape: str = "ellipse"

    def moved(self, rows: float, columns: float) -> Thing:
        return Thing(self.row + rows, self.column + columns, self.half, self.colours, self.shape)


class Artist:
    """Draws pictures; its noise is repeatable."""

    def __init__(self, noise: float = 1.5) -> None:
        self.noise = noise
        self._random = np.random.default_rng(7)

    def picture(self, things: Iterable[Thing] = (), size: tuple[int, int] = SIZE) -> Image:
        """Things on the table, the later ones in front."""
        canvas = np.full((*size, 3), TABLE, np.float64)
        for thing in things:
            self._paint(canvas, thing)
        return self.noisy(canvas)

    def with_marker(self, image: Image, marker_id: int, image_from_unit: NDArray[np.float64]) -> Image:
        """The picture with a marker whose black square is [−1, 1]² under the 3×3 warp (x right, y down)."""
        printed = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        square = cv2.aruco.generateImageMarker(printed, marker_id, 192)
        plate = cv2.copyMakeBorder(square, 32, 32, 32, 32, cv2.BORDER_CONSTANT, value=255)
        half = plate.shape[0] / 2
        unit_from_plate = np.array([[1 / 96, 0, (0.5 - half) / 96], [0, 1 / 96, (0.5 - half) / 96], [0, 0, 1]])
        image_from_fine = np.array([[1 / FINE, 0, 0.5 / FINE - 0.5], [0, 1 / FINE, 0.5 / FINE - 0.5], [0, 0, 1]])
        warp = np.linalg.inv(image_from_fine) @ image_from_unit @ unit_from_plate
        rows, columns = image.shape[:2]
        layers = np.dstack((plate, np.full_like(plate, 255)))
        fine = cv2.warpPerspective(layers, warp, (columns * FINE, rows * FINE))
        shown = cv2.resize(fine, (columns, rows), interpolation=cv2.INTER_AREA).astype(np.float64)
        canvas = image * (1 - shown[..., 1:] / 255) + shown[..., :1]
        return self.noisy(canvas)

    def noisy(self, canvas: NDArray[np.float64]) -> Image:
        noise = self._random.normal(0.0, self.noise, canvas.shape)
        return np.clip(np.rint(canvas + noise), 0, 255).astype(np.uint8)

    @staticmethod
    def _paint(canvas: NDArray[np.float64], thing: Thing) -> None:
        rows, columns = canvas.shape[:2]
        y = ((np.arange(rows * FINE) + 0.5) / FINE - 0.5 - thing.row) / thing.half[0]
        x = ((np.arange(columns * FINE) + 0.5) / FINE - 0.5 - thing.column) / thing.half[1]
        if thing.shape == "ellipse":
            inside = y[:, None] ** 2 + x[None, :] ** 2 <= 1
        else:
            inside = (np.abs(y) <= 1)[:, None] & (np.abs(x) <= 1)[None, :]
        for number, colour in enumerate(thing.colours):
            band = (y + 1) / 2 * len(thing.colours)
            part = inside & ((band >= number) & (band < number + 1))[:, None]
            cover = part.reshape(rows, FINE, columns, FINE).mean(axis=(1, 3))[..., None]
            canvas *= 1 - cover
            canvas += cover * np.array(colour, np.float64)


@pytest.fixture
def artist() -> Artist:
    return Artist()


def marker_warp(row: float, column: float, half: float, turn: float, oblique: float) -> NDArray[np.float64]:
    """A marker's 3×3 warp: centre (row, column) and half side in px, turned, seen `oblique` rad from the side."""
    c, s = np.cos(turn), np.sin(turn)
    place = np.array([[1, 0, column], [0, 1, row], [0, 0, 1]])
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    # A camera at a distance of 30 half sides sees the far half smaller.
    tilt = np.array([[half, 0, 0], [0, half * np.cos(oblique), 0], [0, np.sin(oblique) / 30, 1]])
    return np.asarray(place @ rotation @ tilt)
