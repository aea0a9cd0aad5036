"""The coordinator's eyes: a stereo pair from the cameras, and where object and hand are in it (RSS)."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from handeye.camera_bridge.driver import CameraDriver, Image, StereoPair, Tick
from handeye.modules.guided import Guesses, GuidedRecogniser
from handeye.modules.object_model import ObjectModel
from handeye.modules.pipeline import Sees, recognise
from handeye.modules.recognition import NotSeen, Recogniser
from handeye.modules.spaces import HeadAngles, ImagePair, ImagePoint
from handeye.server.problem import Invalid, NotFound


class Sight(Sees, Protocol):
    """What finds objects and the hand (RSS), and learns objects too; `Vision` is one."""

    def see_object(self, left: Image, right: Image, name: str, head: HeadAngles, /) -> tuple[ImagePoint, float]:
        """Where the object is, and the confidence in [0, 1]."""
        ...

    def see_hand(self, left: Image, right: Image, head: HeadAngles, /) -> tuple[ImagePoint, float]:
        """Where the hand is, and the confidence in [0, 1]."""
        ...

    def learn(self, name: str, backgrounds: list[Image], examples: list[Image]) -> None:
        """Learns what object `name` looks like; `Invalid` says what is wrong with the pictures."""
        ...

    def forget(self, name: str) -> None:
        """Does not find object `name` any more."""
        ...


class Vision:
    """Guided recognition (RSS) of `handeye.modules.guided`, taught by pictures.

    The guides are made anew in a thread of their own; close it.
    """

    def __init__(self) -> None:
        self._recogniser = GuidedRecogniser(Recogniser())
        self._rebuilding: threading.Thread | None = None
        self._closed = threading.Event()
        self._lock = threading.Lock()

    def learn(self, name: str, backgrounds: list[Image], examples: list[Image]) -> None:
        """Learns what object `name` looks like; `Invalid` says what is wrong with the pictures."""
        try:
            self._recogniser.register(name, ObjectModel.learn(backgrounds, examples))
        except ValueError as error:
            raise Invalid(f"Object '{name}' cannot be learned: {error}") from error

    def forget(self, name: str) -> None:
        """Does not find object `name` any more."""
        self._recogniser.forget(name)

    def see(self, left: Image, right: Image, name: str, head: HeadAngles, /) -> ImagePair:
        """Object and hand in the two pictures; `NotSeen` says what is missing in which picture.

        `NotFound` when the object has been deleted.
        """
        with _known(name):
            found = self._recogniser.see(left, right, name, head)
        self._keep_guides()
        return found

    def see_object(self, left: Image, right: Image, name: str, head: HeadAngles, /) -> tuple[ImagePoint, float]:
        """The object and the confidence in [0, 1]; raises as `see` does."""
        with _known(name):
            found = self._recogniser.see_object(left, right, name, head)
        self._keep_guides()
        return found

    def see_hand(self, left: Image, right: Image, head: HeadAngles, /) -> tuple[ImagePoint, float]:
        """The hand and the confidence in [0, 1]; raises as `see` does."""
        found = self._recogniser.see_hand(left, right, head)
        self._keep_guides()
        return found

    def guesses(self, left: Image, right: Image, name: str | None, head: HeadAngles) -> Guesses | None:
        """Where the guides expect an object, or the hand for None; None as long as they know nothing."""
        return self._recogniser.guesses(left, right, name, head)

    def settle(self) -> None:
        """Waits until no guide is being made anew."""
        with self._lock:
            rebuilding = self._rebuilding
        if rebuilding is not None:
            rebuilding.join()

    def close(self) -> None:
        """Makes no guide anew any more; waits for the one that is being made."""
        self._closed.set()
        self.settle()

    def _keep_guides(self) -> None:
        """Begins to make guides anew when that is due, in one thread at a time."""
        with self._lock:
            busy = self._rebuilding is not None and self._rebuilding.is_alive()
            if self._recogniser.due and not busy and not self._closed.is_set():
                self._rebuilding = threading.Thread(target=self._rebuild, name="guides", daemon=True)
                self._rebuilding.start()

    def _rebuild(self) -> None:
        while self._recogniser.due and not self._closed.is_set():
            self._recogniser.rebuild()


@contextmanager
def _known(name: str) -> Iterator[None]:
    """`NotFound` for `KeyError`: somebody may delete an object while it is looked for."""
    try:
        yield
    except KeyError as error:
        raise NotFound(f"Object '{name}' is not known any more; show it again by POST /v1/objects/{name}.") from error


@dataclass(frozen=True, slots=True)
class Sighting:
    """A stereo pair and what was found in it, or why it was not."""

    pair: StereoPair
    found: ImagePair | NotSeen

    @property
    def world_time(self) -> float:
        """World time that the left picture shows, in s."""
        return self.pair.left.world_time


class Eyes:
    """Both cameras and the recognition behind them; a picture is waited for `timeout` s."""

    def __init__(self, cameras: CameraDriver, sight: Sight, timeout: float) -> None:
        self._cameras = cameras
        self._sight = sight
        self._timeout = timeout

    @property
    def latency(self) -> float:
        """A picture can be had this long after what it shows, in s of world time."""
        return self._cameras.latency

    def grab(self, not_older_than: float, on_tick: Tick | None = None) -> StereoPair:
        """A pair that shows the world at `not_older_than` (world time in s) or later.

        `DeadlineExceeded` when there is no such pair in time. `on_tick` is called about every 20 ms while it waits for
        the pictures; what it raises ends the wait.
        """
        return self._cameras.grab_stereo(not_older_than, self._timeout, on_tick)

    def recognise(self, pair: StereoPair, object_name: str, object_at: ImagePoint | None = None) -> Sighting:
        """Object and hand in a pair, or why not. An object that a person has marked is not looked for: `object_at`."""
        left, right, head = _views(pair)
        try:
            if object_at is None:
                return Sighting(pair, recognise(self._sight, left, right, object_name, head))
            hand, confidence = self._sight.see_hand(left, right, head)
            return Sighting(pair, ImagePair(object_at, hand, hand_confidence=confidence))
        except NotSeen as missing:
            return Sighting(pair, missing)

    def find(self, pair: StereoPair, object_name: str | None) -> ImagePoint:
        """The object in a pair, or the hand for None; raises `NotSeen`."""
        return self.see(pair, object_name)[0]

    def see(self, pair: StereoPair, object_name: str | None) -> tuple[ImagePoint, float]:
        """The object in a pair, or the hand for None, and the confidence in [0, 1]; raises `NotSeen`."""
        left, right, head = _views(pair)
        if object_name is None:
            return self._sight.see_hand(left, right, head)
        return self._sight.see_object(left, right, object_name, head)


def _views(pair: StereoPair) -> tuple[Image, Image, HeadAngles]:
    """Left and right picture, and from where they were taken."""
    return pair.left.image, pair.right.image, HeadAngles(pair.head.pan, pair.head.tilt)
