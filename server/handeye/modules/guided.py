"""Guided recognition (RSS): four guides say roughly where to look, and detection searches there first (thesis 4.2.7).

One guide for each of {left, right} × {object, hand}. Detection searches a narrow window around the guess, then a wider
one, then the whole picture; where a guess has low support, or the head points where it never has, the whole picture at
once. So a blunder costs time, never the task: what is found is what detection finds. And each find teaches the guides.

The object's guides see how probably each cell shows the object's colours, the hand's see grey pictures with the arm.
"""

from __future__ import annotations

import threading
from typing import Literal, NamedTuple

import cv2
import numpy as np

from handeye.modules.guide import NARROW, GreyPicture, Guess, Guide, Imagination, reduced
from handeye.modules.object_model import ObjectModel
from handeye.modules.recognition import NotSeen, Recogniser, Windows
from handeye.modules.spaces import HeadAngles, ImagePair, ImagePoint
from handeye.modules.window import Image, Window

Side = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")

REACHES = (NARROW, 5 / 32)
"""The windows reach so far from the guess, as shares of the picture's width: 40 and 100 px of 640."""

_STRAIGHT = HeadAngles(0.0, 0.0)  # of a head that nobody tells of: it never turns
_ROWS_AGREE = 0.06  # of the width: guesses in left and right picture whose rows are farther apart are not one point
_DISPARITIES_AGREE = 0.035  # of the width: nor are those whose disparity is so far beyond all that were found
_OF_OBJECT = Imagination(count=2, reach=1 / 4)  # before nothing: wherever it is, it looks the same
_OF_HAND = Imagination(count=2, reach=1 / 16)  # the arm that comes with it looks much the same nearby only
_SAME_SCENE = 8.0  # px that a thing may have moved

_Reduced = tuple[Image, Image]
"""Left and right picture in colour, strongly reduced."""
_Views = tuple[GreyPicture, GreyPicture]
"""What the guides see of the left and of the right picture."""


class Guesses(NamedTuple):
    """What the guides say of a stereo pair."""

    left: Guess
    right: Guess
    agree: bool
    """Whether the two can be one point."""

    @property
    def trusted(self) -> bool:
        """Whether it is worth to search there first."""
        return self.left.trusted and self.right.trusted and self.agree


class _Find(NamedTuple):
    """A point that was found, the confidence, what the guides see of the pictures and from where, and what they had
    guessed."""

    point: ImagePoint
    confidence: float
    views: _Views
    head: HeadAngles
    guesses: Guesses | None


class GuidedRecogniser:
    """Finds what a `Recogniser` finds, sooner. May be used by several threads.

    The guides change how long a look takes. What is found is the same, unless there are several things like the object:
    then it is the one where it was expected.
    """

    def __init__(self, recogniser: Recogniser) -> None:
        self._recogniser = recogniser
        self._guides: dict[tuple[str | None, Side, tuple[int, ...]], Guide] = {}
        self._scenes: dict[str | None, tuple[int, ImagePoint]] = {}
        self._disparities: dict[str | None, tuple[float, float]] = {}
        """The least and the greatest that were found of each thing, px."""
        self._lock = threading.Lock()

    def register(self, name: str, model: ObjectModel) -> None:
        """Makes an object known under `name`; an earlier one of that name is replaced, and its guides are forgotten."""
        self._recogniser.register(name, model)
        self._drop_guides(name)

    def forget(self, name: str) -> None:
        """Makes an object unknown; does nothing when it is."""
        self._recogniser.forget(name)
        self._drop_guides(name)

    def see(self, left: Image, right: Image, name: str, head: HeadAngles = _STRAIGHT) -> ImagePair:
        """As `Recogniser.see`; `head`: where it pointed."""
        self._recogniser.model(name)
        small = _reduced(left, right)
        hand, thing = self._find(left, right, None, head, small), self._find(left, right, name, head, small)
        scene = self._scene(name, thing.point)
        self._teach(None, left.shape, hand, scene)
        self._teach(name, left.shape, thing, scene)
        return ImagePair(thing.point, hand.point, thing.confidence, hand.confidence)

    def see_object(
        self, left: Image, right: Image, name: str, head: HeadAngles = _STRAIGHT
    ) -> tuple[ImagePoint, float]:
        """As `Recogniser.see_object`; `head`: where it pointed."""
        return self._see_one(left, right, name, head)

    def see_hand(self, left: Image, right: Image, head: HeadAngles = _STRAIGHT) -> tuple[ImagePoint, float]:
        """As `Recogniser.see_hand`; `head`: where it pointed."""
        return self._see_one(left, right, None, head)

    def guesses(self, left: Image, right: Image, name: str | None, head: HeadAngles = _STRAIGHT) -> Guesses | None:
        """Where the guides expect an object, or the hand for None; None as long as they know nothing."""
        return self._guesses(name, left.shape, self._views(_reduced(left, right), name), head)

    @property
    def due(self) -> bool:
        """Whether a guide has seen enough new that `rebuild` is worth its time."""
        return any(guide.due for guide in self._known())

    def rebuild(self) -> None:
        """Makes one guide anew that is due, if there is any; about a second. They may be asked meanwhile."""
        for guide in self._known():
            if guide.due:
                guide.rebuild()
                return

    def _known(self) -> list[Guide]:
        with self._lock:
            return list(self._guides.values())

    def _drop_guides(self, name: str) -> None:
        with self._lock:
            self._guides = {key: guide for key, guide in self._guides.items() if key[0] != name}
            self._scenes.pop(name, None)
            self._disparities.pop(name, None)

    def _see_one(self, left: Image, right: Image, name: str | None, head: HeadAngles) -> tuple[ImagePoint, float]:
        find = self._find(left, right, name, head, _reduced(left, right))
        self._teach(name, left.shape, find, self._scene(name, find.point))
        return find.point, find.confidence

    def _find(self, left: Image, right: Image, name: str | None, head: HeadAngles, small: _Reduced) -> _Find:
        """Searches where the guides say, then in ever larger parts; raises as `Recogniser.see_object` does.

        `small`: the pictures, reduced.
        """
        if left.shape != right.shape:
            self._search(left, right, name, None)  # refuses it
        views = self._views(small, name)
        guesses = self._guesses(name, left.shape, views, head)
        if guesses is not None and guesses.trusted:
            for reach in REACHES:
                windows = _windows(guesses, reach * left.shape[1], left.shape)
                if windows is None:
                    continue
                try:
                    return _Find(*self._search(left, right, name, windows), views, head, guesses)
                except NotSeen:
                    continue
        return _Find(*self._search(left, right, name, None), views, head, guesses)

    def _search(self, left: Image, right: Image, name: str | None, windows: Windows | None) -> tuple[ImagePoint, float]:
        if name is None:
            return self._recogniser.see_hand(left, right, windows)
        return self._recogniser.see_object(left, right, name, windows)

    def _views(self, small: _Reduced, name: str | None) -> _Views:
        if name is None:
            first, second = (np.asarray(cv2.cvtColor(each, cv2.COLOR_RGB2GRAY), dtype=np.uint8) for each in small)
        else:
            first, second = (self._recogniser.model(name).likeness(each) for each in small)
        return first, second

    def _guesses(self, name: str | None, shape: tuple[int, ...], views: _Views, head: HeadAngles) -> Guesses | None:
        with self._lock:
            guides = [self._guides.get((name, side, shape)) for side in SIDES]
            least, greatest = self._disparities.get(name, (0.0, 0.0))
        left, right = (
            None if each is None else each.guess(view, head) for each, view in zip(guides, views, strict=True)
        )
        if left is None or right is None:
            return None
        spare, disparity = _DISPARITIES_AGREE * shape[1], left.column - right.column
        agree = abs(left.row - right.row) <= _ROWS_AGREE * shape[1] and least - spare <= disparity <= greatest + spare
        return Guesses(left, right, agree)

    def _scene(self, name: str | None, found: ImagePoint) -> int:
        """Looks one after the other that show a thing at one place are one scene; its number."""
        with self._lock:
            number, first = self._scenes.get(name, (-1, None))
            if first is None or np.abs(found.array() - first.array()).max() > _SAME_SCENE:
                number, first = number + 1, found
                self._scenes[name] = number, first
            return number

    def _teach(self, name: str | None, shape: tuple[int, ...], find: _Find, scene: int) -> None:
        found = find.point
        with self._lock:
            least, greatest = self._disparities.get(name, (found.disparity, found.disparity))
            self._disparities[name] = min(least, found.disparity), max(greatest, found.disparity)
        columns = found.column, found.column - found.disparity
        expected = (None, None) if find.guesses is None else find.guesses[:2]
        for side, view, column, guess in zip(SIDES, find.views, columns, expected, strict=True):
            with self._lock:
                key = name, side, shape
                if key not in self._guides:
                    self._guides[key] = Guide(shape, _OF_HAND if name is None else _OF_OBJECT)
                guide = self._guides[key]
            guide.teach(view, found.row, column, scene, find.head, guess)


def _reduced(left: Image, right: Image) -> _Reduced:
    return reduced(left), reduced(right)


def _windows(guesses: Guesses, reach: float, shape: tuple[int, ...]) -> Windows | None:
    """Around the guesses; None when one of them is beyond its picture."""
    left = Window.around(guesses.left.row, guesses.left.column, reach, shape)
    right = Window.around(guesses.right.row, guesses.right.column, reach, shape)
    return None if left is None or right is None else (left, right)
