"""Pictures of a PyBullet world as one of the lab's cameras takes them.

TinyRenderer draws the ideal pinhole picture twice as large as asked; the lens bends it, averaging two by two pixels
smooths the edges, and the sensor adds its noise. TinyRenderer needs no display and no system library, and repeats
itself to the last bit.

What never moves (table, floor) fills most of a picture, and filling pixels is what costs. It is drawn once for each
pose of a camera and kept with its depths; each picture then draws only what moves and puts the nearer of the two in
every pixel, which gives the same bits as drawing all at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
import pybullet
from numpy.typing import NDArray

from handeye.simulation import lens, rig
from handeye.simulation.profile import Profile

Image = NDArray[np.uint8]

SUPERSAMPLING = 2
"""Drawn pixels for each pixel of the picture, along a row and along a column."""

_NEAR, _FAR = 0.1, 8.0
"""Nearest and farthest distance drawn, in m."""

_LIGHT: dict[str, Any] = {
    "lightDirection": (1.0, -0.6, 1.8),
    "lightColor": (1.0, 1.0, 1.0),
    "lightAmbientCoeff": 0.55,
    "lightDiffuseCoeff": 0.5,
    "lightSpecularCoeff": 0.1,
    "shadow": 0,
}
"""A lamp above and behind the rig. Shadows would double the time of a picture."""

_NOISE_BANK_SPARE = 1 << 16


@dataclass(frozen=True, slots=True)
class Drawing:
    """What TinyRenderer drew: colours (rows, columns, 4) and depths (rows, columns) in its own, monotonic measure."""

    colours: Image
    depths: NDArray[np.float32]

    def over(self, background: Drawing) -> Drawing:
        """The nearer of the two in every pixel; where they are equally near, the background."""
        nearer = cv2.compare(self.depths, background.depths, cv2.CMP_LT)
        colours = background.colours.copy()
        cv2.copyTo(self.colours, nearer, colours)
        return Drawing(colours, np.minimum(self.depths, background.depths))


class Camera:
    """One of the lab's cameras: its optics, its lens and its sensor's noise.

    A picture is `develop(draw(client, camera_from_world), seed, step)`: deterministic, the same for the same arguments.
    """

    def __init__(self, name: rig.CameraName, profile: Profile) -> None:
        self.name = name
        optics = rig.intrinsics(name)
        self._index = rig.CAMERAS.index(name)
        self._noise = profile.pixel_noise
        self._size = (optics.width, optics.height)
        scale = SUPERSAMPLING
        # A pixel's centre (r, c) lies at (r + 0.5) * scale - 0.5 among the drawn pixels.
        focal = optics.focal_length * scale
        row = (optics.principal_row + 0.5) * scale - 0.5
        column = (optics.principal_column + 0.5) * scale - 0.5
        width, height = optics.width * scale, optics.height * scale
        self._maps: tuple[NDArray[np.int16], NDArray[np.uint16]] | None = None
        spare_columns = spare_rows = 0
        if (profile.k1, profile.k2) != (0.0, 0.0):
            found = lens.bending_maps(width, height, focal, (row, column), profile.k1, profile.k2)
            # The pinhole picture is drawn wider, so that the bent one has no empty corner.
            spare_columns = _spare(found[..., 0], width)
            spare_rows = _spare(found[..., 1], height)
            self._maps = _fixed_point(found + np.array([spare_columns, spare_rows], dtype=np.float32))
        self._drawn = (width + 2 * spare_columns, height + 2 * spare_rows)
        self._projection = _projection(self._drawn, focal, row + spare_rows, column + spare_columns)

    def draw(self, client: int, camera_from_world: rig.Matrix) -> Drawing:
        """Draws everything in a PyBullet client as the camera at this pose sees it, without lens and noise."""
        width, height = self._drawn
        _, _, colours, depths, _ = pybullet.getCameraImage(
            width,
            height,
            viewMatrix=_view(camera_from_world),
            projectionMatrix=self._projection,
            renderer=pybullet.ER_TINY_RENDERER,
            flags=pybullet.ER_NO_SEGMENTATION_MASK,
            physicsClientId=client,
            **_LIGHT,
        )
        return Drawing(colours, depths)

    def develop(self, drawing: Drawing, seed: int, step: int) -> Image:
        """The picture (rows, columns, 3) red green blue: bent by the lens, smoothed, with the sensor's noise.

        The noise follows from `seed`, the camera and the physics step of the exposure alone, so that it does not matter
        how many pictures were taken before.
        """
        colours = cv2.cvtColor(drawing.colours, cv2.COLOR_RGBA2RGB)
        if self._maps is not None:
            colours = cv2.remap(colours, *self._maps, interpolation=cv2.INTER_LINEAR)
        picture = cv2.resize(colours, self._size, interpolation=cv2.INTER_AREA)
        if self._noise > 0.0:
            picture = cv2.add(picture, self._noise_of(picture.shape, seed, step), dtype=cv2.CV_8U)
        result: Image = picture.astype(np.uint8, copy=False)
        return result

    def _noise_of(self, shape: tuple[int, ...], seed: int, step: int) -> NDArray[np.int16]:
        count = int(np.prod(shape))
        bank = _noise_bank(count, self._noise)
        start = int(np.random.default_rng([seed, self._index, step]).integers(_NOISE_BANK_SPARE))
        return bank[start : start + count].reshape(shape)


@cache
def _noise_bank(count: int, deviation: float) -> NDArray[np.int16]:
    """Normal noise in grey levels, drawn once: a picture takes a stretch of it that starts at its own place."""
    noise = np.random.default_rng(0).normal(0.0, deviation, count + _NOISE_BANK_SPARE)
    bank: NDArray[np.int16] = np.rint(noise).astype(np.int16)
    bank.setflags(write=False)
    return bank


def _projection(size: tuple[int, int], focal: float, row: float, column: float) -> list[float]:
    """OpenGL's projection matrix, column by column, for a pinhole camera with the principal point at (row, column).

    TinyRenderer samples half a pixel beside the pixels' centres: half a pixel less in x and more in y makes up for it.
    """
    width, height = size
    x = column  # (column + 0.5) - 0.5
    y = row + 1.0  # (row + 0.5) + 0.5
    matrix = np.zeros((4, 4))
    matrix[0, 0] = 2.0 * focal / width
    matrix[1, 1] = 2.0 * focal / height
    matrix[0, 2] = 1.0 - 2.0 * x / width
    matrix[1, 2] = 2.0 * y / height - 1.0
    matrix[2, 2] = -(_FAR + _NEAR) / (_FAR - _NEAR)
    matrix[2, 3] = -2.0 * _FAR * _NEAR / (_FAR - _NEAR)
    matrix[3, 2] = -1.0
    values: list[float] = matrix.T.ravel().tolist()
    return values


def _view(camera_from_world: rig.Matrix) -> list[float]:
    """OpenGL's view matrix, column by column: its y points up and it looks along -z."""
    view = np.diag([1.0, -1.0, -1.0, 1.0]) @ camera_from_world
    values: list[float] = view.T.ravel().tolist()
    return values


def _spare(found: NDArray[np.float32], size: int) -> int:
    """How far positions reach beyond a picture's edge, in whole, even pixels, with room to interpolate."""
    beyond = max(0.0, -float(found.min()), float(found.max()) - (size - 1))
    return 2 * (int(beyond) // 2 + 1)


def _fixed_point(maps: NDArray[np.float32]) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
    """OpenCV's fast form of the maps (positions to 1/32 pixel)."""
    whole, fraction = cv2.convertMaps(maps[..., 0], maps[..., 1], cv2.CV_16SC2)
    return whole.astype(np.int16, copy=False), fraction.astype(np.uint16, copy=False)
