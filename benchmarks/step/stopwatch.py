"""Where the time of a step goes."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

Call = Callable[..., Any]

SUM = "sum"


@dataclass(frozen=True, slots=True)
class Spent:
    """Time in s: by the clock on the wall, and of all threads of this process on cores, whatever else these do."""

    wall: float
    cpu: float

    @classmethod
    def now(cls) -> Spent:
        """Both clocks."""
        return cls(time.perf_counter(), time.process_time())

    def __add__(self, other: Spent) -> Spent:
        return Spent(self.wall + other.wall, self.cpu + other.cpu)

    def __sub__(self, other: Spent) -> Spent:
        return Spent(self.wall - other.wall, self.cpu - other.cpu)


class Stopwatch:
    """Times parts of steps. A step lasts from one call of what begins it to the next one."""

    def __init__(self) -> None:
        self.steps: list[dict[str, Spent]] = []
        """What each part of each whole step took, and under `SUM` the whole step."""
        self._parts: dict[str, Spent] = defaultdict(lambda: Spent(0.0, 0.0))
        self._begun: Spent | None = None

    def begin(self) -> None:
        """A step begins; the one before, if there is one, is whole."""
        now = Spent.now()
        if self._begun is not None:
            self.steps.append({**self._parts, SUM: now - self._begun})
        self._parts.clear()
        self._begun = now

    def leave(self) -> None:
        """What has begun is no whole step and does not count."""
        self._begun = None

    def timed(self, part: str, call: Call, *, begins: bool = False) -> Call:
        """`call`, its time added to a part; it may begin a step."""

        def measured(*args: Any, **kwargs: Any) -> Any:
            if begins:
                self.begin()
            started = Spent.now()
            try:
                return call(*args, **kwargs)
            finally:
                self._parts[part] += Spent.now() - started

        return measured

    @contextmanager
    def watching(self, owner: Any, name: str, part: str, *, begins: bool = False) -> Iterator[None]:
        """Meanwhile the time that `owner.name(…)` takes is added to a part."""
        original = getattr(owner, name)
        setattr(owner, name, self.timed(part, original, begins=begins))
        try:
            yield
        finally:
            setattr(owner, name, original)
