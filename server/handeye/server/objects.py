"""Objects: what they look like, learned from a few pictures without and with them.

Kept in memory: objects do not survive a restart of the coordinator.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

from handeye.camera_bridge.driver import Image, StereoPair
from handeye.server.problem import Conflict, NotFound

MOST_PAIRS = 20
"""Stereo pairs of one kind that an object may have: more teach nothing and fill the memory."""

Kind = Literal["backgrounds", "examples"]


@dataclass
class TaughtObject:
    """The pictures of one object so far: left and right, in the order they were taken."""

    name: str
    backgrounds: list[Image] = field(default_factory=list)
    examples: list[Image] = field(default_factory=list)

    @property
    def learned(self) -> bool:
        """There is at least one pair of each kind, hence a model."""
        return bool(self.backgrounds) and bool(self.examples)


class Objects:
    """The objects and their pictures; `learn` is called with (name, backgrounds, examples) at every new picture."""

    def __init__(self, learn: Callable[[str, list[Image], list[Image]], None]) -> None:
        self._learn = learn
        self._objects: dict[str, TaughtObject] = {}
        self._lock = threading.Lock()

    def add(self, name: str, kind: Kind, pair: StereoPair) -> TaughtObject:
        """Adds a pair and learns the object anew from all pictures so far, once it has both kinds.

        When learning fails the pair is not kept and the error goes on.
        """
        with self._lock:
            taught = self._objects.get(name) or TaughtObject(name)
            backgrounds, examples = list(taught.backgrounds), list(taught.examples)
            images = backgrounds if kind == "backgrounds" else examples
            if len(images) >= 2 * MOST_PAIRS:
                raise Conflict(f"Object '{name}' has {MOST_PAIRS} {kind} already; that is as many as it may have.")
            images += [pair.left.image, pair.right.image]
            if backgrounds and examples:
                self._learn(name, backgrounds, examples)
            self._objects[name] = TaughtObject(name, backgrounds, examples)
            return self._objects[name]

    def all(self) -> tuple[TaughtObject, ...]:
        """Every object, in the order of their first pictures."""
        with self._lock:
            return tuple(self._objects.values())

    def require(self, name: str) -> None:
        """Raises `NotFound` unless the object can be recognised."""
        known = [taught.name for taught in self.all() if taught.learned]
        if name not in known:
            listed = ", ".join(map(repr, known)) or "none yet"
            raise NotFound(
                f"Object '{name}' is not learned (learned: {listed}); show it by POST /v1/objects/{name}/backgrounds "
                f"and POST /v1/objects/{name}/examples."
            )
