"""Pictures of a made-up scene, in which one object is to be found."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Images = NDArray[np.uint8]


def render(seed: int, n: int, world: int = 0, shape: tuple[int, int] = (480, 640)) -> tuple[Images, Floats]:
    """A bright textured object and a dark larger one at random places before the same clutter; where the bright one is.

    Brightness changes from image to image, and pixels are noisy.

    Args:
        seed: of places, brightness and noise.
        n: how many images.
        world: what clutter and objects look like; another world is another scene.
        shape: rows and columns.

    Returns:
        (n, rows, columns) images and (n, 2) the middle of the bright object: row, column [px].
    """
    scene, rng = np.random.default_rng(world), np.random.default_rng(seed)
    rows, columns = shape
    unit = rows // 24
    clutter = np.full(shape, 110.0)
    for _ in range(40):
        r, c = scene.integers(0, rows), scene.integers(0, columns)
        h, w = scene.integers(unit, 6 * unit, 2)
        clutter[r : r + h, c : c + w] = scene.uniform(50, 190)
    thing = 210 + 30 * np.kron(scene.normal(size=(4, 3)), np.ones((unit, unit)))
    other = 50 + 20 * np.kron(scene.normal(size=(6, 3)), np.ones((unit, unit)))
    images, places = np.empty((n, *shape), np.uint8), np.empty((n, 2))
    for i in range(n):
        image = clutter.copy()
        for patch in (other, thing):
            h, w = patch.shape
            r, c = rng.integers(0, rows - h + 1), rng.integers(0, columns - w + 1)
            image[r : r + h, c : c + w] = patch
            places[i] = r + (h - 1) / 2, c + (w - 1) / 2
        image = image * rng.uniform(0.9, 1.1) + rng.normal(0, 4, shape)
        images[i] = np.clip(image, 0, 255)
    return images, places
