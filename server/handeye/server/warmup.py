"""Readiness: what the coordinator needs before it can work, and what of it is missing."""

from __future__ import annotations

import threading
from collections.abc import Callable

import structlog

_LIMIT = 10.0  # s

log = structlog.get_logger(__name__)

Step = Callable[[Callable[[str], None]], None]
"""Something to do before the coordinator is ready; it is given what tells people what is under way."""


class WarmUp:
    """Does the steps in a thread from now on, one after the other; `missing` says what is not done yet."""

    def __init__(self, *steps: Step) -> None:
        self._steps = steps
        self._missing: str | None = "the coordinator has just started"
        self._thread = threading.Thread(target=self._run, name="warm-up", daemon=True)
        self._thread.start()

    @property
    def missing(self) -> str | None:
        """A sentence about what is not ready yet; None when all is."""
        return self._missing

    def close(self) -> None:
        """Waits for the step under way: a compiler that is cut off can crash the interpreter's exit. 10 s at most."""
        self._thread.join(_LIMIT)

    def _run(self) -> None:
        for step in self._steps:
            try:
                step(self._tell)
            except Exception as error:  # shown by /readyz: the coordinator answers, but is never ready
                log.exception("the coordinator cannot become ready")
                self._missing = f"{self._missing}, which failed: {error}"
                return
        self._missing = None

    def _tell(self, sentence: str) -> None:
        self._missing = sentence
