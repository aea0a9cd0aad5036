"""One that sees what the coordinator's cameras see, recognises as the coordinator does, and is timed at it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial

from handeye.modules.guided import REACHES, GuidedRecogniser
from handeye.modules.marker import Marker
from handeye.modules.object_model import ObjectModel
from handeye.modules.recognition import Recogniser, Windows
from handeye.modules.silhouette import rough_places
from handeye.modules.spaces import HeadAngles, ImagePoint
from handeye.modules.window import Image, Window
from handeye.simulation.evaluation.disturbing import Pair
from handeye.simulation.evaluation.site import Site
from handeye.simulation.gripper import MARKER_ID
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.teacher import FRESH, registration_places

_ROUNDS = 3  # timings of one look, of which the fastest counts


class Onlooker:
    """Sees what the coordinator's cameras see, and recognises as it does. A thing's name is None for the hand."""

    def __init__(self, site: Site) -> None:
        self.site = site
        self.recogniser = Recogniser(MARKER_ID)
        self.guided = GuidedRecogniser(self.recogniser)
        self._marker = Marker(MARKER_ID)

    def pair(self, not_older_than: float = 0.0) -> Pair:
        """What both cameras see."""
        client = self.site.client
        return client.image("left", not_older_than).pixels, client.image("right", not_older_than).pixels

    def look(self) -> Pair:
        """What they see now that all is at rest."""
        with self.site.client.control("referee") as control:
            now = control.state().world_time
            control.advance(FRESH)
        return self.pair(now)

    @property
    def head(self) -> HeadAngles:
        """Where the head points."""
        head = self.site.client.head()
        return HeadAngles(head.pan, head.tilt)

    def learn(self, spec: ObjectSpec, seed: int) -> None:
        """Has an object shown, to the coordinator too, and learns it from the same kind of pictures."""
        site = self.site
        site.lab.reset(seed)
        backgrounds = [*self.look(), *self.look()]
        examples: list[Image] = []
        for number, place in enumerate(registration_places()):
            site.lab.place(spec, place, yaw=0.5 + 1.3 * number)
            examples += self.look()
        self.guided.register(spec.name, ObjectModel.learn(backgrounds, examples))

    def find(self, pair: Pair, name: str | None, windows: Windows | None = None) -> ImagePoint:
        """What is found without guides, in whole pictures or in windows. NotSeen where it is not."""
        recogniser = self.recogniser
        found = recogniser.see_hand(*pair, windows) if name is None else recogniser.see_object(*pair, name, windows)
        return found[0]

    def timed(self, pair: Pair, name: str | None, found: ImagePoint) -> dict[str, float]:
        """ms of one look, by turns: at whole pictures, at windows, the guides alone, and all that guided looking is.

        Of the processor's time: others work on the same cores.
        """
        shape = pair[0].shape
        left = Window.around(found.row, found.column, REACHES[0] * shape[1], shape)
        right = Window.around(found.row, found.column - found.disparity, REACHES[0] * shape[1], shape)
        assert left is not None and right is not None  # noqa: S101, PT018 # it was found there
        guided, whole, head = self.guided, Window.whole(shape), self.head
        calls: dict[str, Callable[[], object]] = {
            "search_whole_ms": partial(self._search, pair, name, (whole, whole)),
            "search_window_ms": partial(self._search, pair, name, (left, right)),
            "whole_ms": partial(self.find, pair, name),
            "window_ms": partial(self.find, pair, name, (left, right)),
            "guides_ms": partial(guided.guesses, *pair, name, head),
            "guided_ms": partial(guided.see_hand, *pair, head)
            if name is None
            else partial(guided.see_object, *pair, name, head),
        }
        least = dict.fromkeys(calls, math.inf)
        for _ in range(_ROUNDS):
            for key, call in calls.items():
                started = time.thread_time()
                call()
                least[key] = min(least[key], 1e3 * (time.thread_time() - started))
        return least

    def _search(self, pair: Pair, name: str | None, windows: Windows) -> None:
        """Detection alone, without the alignment to a fraction of a pixel, which costs the same in a window."""
        for picture, window in zip(pair, windows, strict=True):
            if name is None:
                self._marker.detects(picture, window)
            else:
                model = self.recogniser.model(name)
                rough_places(picture, model.object_probability, model.templates, window)
