"""The guide: an MDF tree that says from a strongly reduced picture roughly where something is (thesis 4.2.7).

It only says where to search first. It learns from what detection itself found, never from truth, and what it knows is a
cache: it is kept in memory, rebuilt from the last pictures when enough of them have surprised it, and after a restart
learned anew by looking.

A taught picture also teaches what it would be if the head were turned a little: it is shifted, and the place with it.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from handeye.modules.spaces import Floats, HeadAngles
from handeye.modules.window import Image
from handeye.rpt.mdf import MDFSettings, MDFTree

GreyPicture = NDArray[np.uint8]
"""A strongly reduced picture, shape (rows, columns)."""

_LONGER_SIDE = 40  # cells of a reduced picture: 16 × 16 px each of 640 × 480
_SETTINGS = MDFSettings(cells=20)
_KEPT = 320  # pictures; a new one takes the place of any: what was long ago fades, and does not end at once
_LEAST = 24  # pictures from which a first tree is made
_GROWTH = 1.5  # a tree is made anew when so many times the pictures that it was made of have been seen and surprised
NARROW = 1 / 16
"""What is found farther than this from where it was expected, as a share of the picture's width, is a surprise."""
_LOW_SUPPORT = 0.005  # all but one in 200 of the taught pictures were more like the others
_SAME_VIEW = 0.05  # rad: from where the head pointed in the taught pictures; 30 px in a picture of 640
_LEAST_CONTRAST = 0.5  # of the flattest taught picture's: the tree itself stretches every picture to full contrast


@dataclass(frozen=True, slots=True)
class Guess:
    """Roughly where something is, in px of the whole picture, and how much the picture is like the taught ones, 0…1."""

    row: float
    column: float
    support: float
    trusted: bool
    """Whether the support is not low and the head points where it has pointed before: it is worth to search there."""


@dataclass(frozen=True, slots=True)
class Imagination:
    """How a taught picture is varied: so many times, shifted by up to this share of its width along each axis."""

    count: int
    reach: float


class _Taught(NamedTuple):
    picture: GreyPicture
    row: float
    column: float
    scene: int
    head: HeadAngles


class _Built(NamedTuple):
    tree: MDFTree
    heads: Floats
    """(n, 2) where the head pointed in the taught pictures, in rad."""
    flattest: float
    """Standard deviation of the flattest taught picture's grey levels."""


def reduced(image: Image) -> Image:
    """A colour picture of 40 cells along its longer side; shape (rows, columns, 3)."""
    share = _LONGER_SIDE / max(image.shape)
    rows, columns = (max(1, round(length * share)) for length in image.shape[:2])
    return np.asarray(cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.uint8)


class Guide:
    """Where one thing is in one camera's pictures of one size. May be used by several threads."""

    def __init__(self, shape: tuple[int, ...], imagination: Imagination) -> None:
        """`shape` of the whole pictures (rows, columns, …)."""
        self._shape = shape
        self._imagination = imagination
        self._taught: list[_Taught] = []
        self._random = np.random.default_rng(0)
        self._surprises = 0
        self._due_at = float(_LEAST)
        self._built: _Built | None = None
        self._lock = threading.Lock()

    def guess(self, picture: GreyPicture, head: HeadAngles) -> Guess | None:
        """Where the thing is in a reduced picture, seen with the head at `head`; None as long as nothing is known."""
        built = self._built
        if built is None:
            return None
        answer = built.tree.answer(picture)
        row, column = answer.output.tolist()
        flat = picture.std() < _LEAST_CONTRAST * built.flattest
        support = 0.0 if flat else float(answer.support)
        # Among few taught pictures even the unlikest one has the support 1 / (n + 1).
        least = max(_LOW_SUPPORT, 1 / (len(built.tree.outputs) + 1))
        # A picture from elsewhere may be like a taught one by chance: all of it is shifted, and the thing is not there.
        known = bool((np.abs(built.heads - (head.pan, head.tilt)).max(axis=1) < _SAME_VIEW).any())
        return Guess(row, column, support, trusted=known and support > least)

    def teach(
        self,
        picture: GreyPicture,
        row: float,
        column: float,
        scene: int,
        head: HeadAngles,
        expected: Guess | None = None,
    ) -> None:
        """The thing was found at (row, column), px of the whole picture, and `expected` had been guessed.

        `scene`: pictures of one are alike. `head`: where it pointed.
        """
        surprising = (
            expected is None
            or not expected.trusted
            or max(abs(row - expected.row), abs(column - expected.column)) > NARROW * self._shape[1]
        )
        with self._lock:
            if len(self._taught) == _KEPT:
                self._taught.pop(int(self._random.integers(_KEPT)))
            self._taught.append(_Taught(picture, row, column, scene, head))
            self._surprises += surprising

    @property
    def due(self) -> bool:
        """Whether enough has surprised that a new tree is worth its time."""
        return self._surprises >= self._due_at

    def rebuild(self) -> None:
        """Makes a new tree of the pictures that are kept; takes about a second. Guesses go on meanwhile."""
        with self._lock:
            taught = tuple(self._taught)
            self._due_at = self._surprises + (_GROWTH - 1) * len(taught)
        heads = np.unique([(each.head.pan, each.head.tilt) for each in taught], axis=0)
        self._built = _Built(self._grow(taught), heads, min(float(each.picture.std()) for each in taught))

    def _grow(self, taught: tuple[_Taught, ...]) -> MDFTree:
        random = np.random.default_rng(len(taught))
        samples = [*taught, *(self._imagine(each, random) for each in taught for _ in range(self._imagination.count))]
        return MDFTree.fit(
            np.stack([each.picture for each in samples]),
            np.array([(each.row, each.column) for each in samples]),
            groups=np.array([each.scene for each in samples]),
            settings=_SETTINGS,
        )

    def _imagine(self, seen: _Taught, random: np.random.Generator) -> _Taught:
        """The picture shifted; what was at its border fills what comes into view. The thing stays in the picture."""
        at = np.array([seen.row, seen.column])
        moved = np.clip(
            at + random.uniform(-1.0, 1.0, 2) * self._imagination.reach * self._shape[1],
            0,
            np.array(self._shape[:2]) - 1,
        )
        rows, columns = (moved - at) * np.array(seen.picture.shape) / self._shape[:2]
        warp = np.array([[1, 0, columns], [0, 1, rows]])
        shifted = cv2.warpAffine(
            seen.picture, warp, seen.picture.shape[::-1], flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return _Taught(np.asarray(shifted, dtype=np.uint8), float(moved[0]), float(moved[1]), seen.scene, seen.head)
