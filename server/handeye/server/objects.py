"""Objects: what they look like, learned from a few pictures without and with them. The pictures are in the store."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeVar

from handeye.camera_bridge.driver import Image, StereoPair
from handeye.server.problem import Conflict, NotFound
from handeye.server.store import Store
from handeye.server.store import objects as stored

MOST_PAIRS = 20
"""Stereo pairs of one kind that an object may have: more teach nothing and fill the memory."""

Kind = Literal["backgrounds", "examples"]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class TaughtObject:
    """An object and how many stereo pairs without and with it are known."""

    name: str
    backgrounds: int
    examples: int

    @property
    def learned(self) -> bool:
        """There is at least one pair of each kind, hence a model."""
        return bool(self.backgrounds) and bool(self.examples)


Write = Callable[[Callable[[], TaughtObject]], T]
"""What does a write in a transaction: at once, or once for a repeated request."""


class Objects:
    """The objects; `learn` is called with (name, backgrounds, examples) at every new picture, `forget` with a name."""

    def __init__(
        self, store: Store, learn: Callable[[str, list[Image], list[Image]], None], forget: Callable[[str], None]
    ) -> None:
        self._store = store
        self._learn = learn
        self._forget = forget
        self._changing = threading.Lock()

    def add(self, name: str, kind: Kind, pair: StereoPair, write: Write[T]) -> T:
        """Adds a pair and learns the object anew from all pictures so far, once it has both kinds.

        `write` is given what writes the pair down; what it returns is returned. When it does not call that, or learning
        or writing fails, everything is as before.
        """
        written = False

        def note() -> TaughtObject:
            nonlocal written
            with self._store.write() as connection:
                stored.add_pair(connection, name, kind, pair.left.image, pair.right.image)
                written = True
                return self.get(name)

        # Learning takes seconds: before the transaction, not in it.
        with self._changing:
            images = self._images(name)
            if len(images[kind]) >= 2 * MOST_PAIRS:
                raise Conflict(f"Object '{name}' has {MOST_PAIRS} {kind} already; that is as many as it may have.")
            images[kind] += [pair.left.image, pair.right.image]
            if all(images.values()):
                self._learn(name, images["backgrounds"], images["examples"])
            try:
                done = write(note)
            except BaseException:
                self._relearn(name)
                raise
            if not written:
                self._relearn(name)
            return done

    def restore(self, name: str) -> None:
        """Learns an object from the pictures in the store."""
        with self._changing:
            self._relearn(name)

    def _relearn(self, name: str) -> None:
        images = self._images(name)
        if all(images.values()):
            self._learn(name, images["backgrounds"], images["examples"])
        else:
            self._forget(name)

    def _images(self, name: str) -> dict[str, list[Image]]:
        """Left and right pictures by kind, in the order they were taken."""
        images: dict[str, list[Image]] = {"backgrounds": [], "examples": []}
        with self._store.read() as connection:
            for kind, left, right in stored.pairs(connection, name):
                images[kind] += [left, right]
        return images

    def all(self) -> tuple[TaughtObject, ...]:
        """Every object, in the order of their first pictures."""
        with self._store.read() as connection:
            return tuple(_taught(name, stored.counts(connection, name)) for name in stored.names(connection))

    def get(self, name: str) -> TaughtObject:
        """One of them; `NotFound` when there is none."""
        with self._store.read() as connection:
            counts = stored.counts(connection, name)
        if not counts:
            raise NotFound(f"There is no object '{name}'; show it by POST /v1/objects/{name}/backgrounds.")
        return _taught(name, counts)

    def delete(self, name: str) -> None:
        """Forgets an object and its pictures; `NotFound` when there is none."""
        with self._changing:
            with self._store.write() as connection:
                self.get(name)
                stored.drop(connection, name)
            self._forget(name)

    def require(self, name: str) -> None:
        """Raises `NotFound` unless the object can be recognised."""
        known = [taught.name for taught in self.all() if taught.learned]
        if name not in known:
            listed = ", ".join(map(repr, known)) or "none yet"
            raise NotFound(
                f"Object '{name}' is not learned (learned: {listed}); show it by POST /v1/objects/{name}/backgrounds "
                f"and POST /v1/objects/{name}/examples."
            )


def _taught(name: str, counts: dict[str, int]) -> TaughtObject:
    return TaughtObject(name, counts.get("backgrounds", 0), counts.get("examples", 0))
