"""Readiness: what the coordinator needs before it can work, and what of it is missing."""

from __future__ import annotations

import threading
from collections.abc import Callable

import structlog

_LIMIT = 5.0

log = structlog.get_logger(__name__)


class WarmUp:
    """Compiles the learner's kernels in a thread from now on, so that no first query waits for the compiler."""

    def __init__(self, compile_kernels: Callable[[], None]) -> None:
        self._compile = compile_kernels
        self._missing: str | None = "the learner's kernels are being compiled"
        self._thread = threading.Thread(target=self._run, name="warm-up", daemon=True)
        self._thread.start()

    @property
    def missing(self) -> str | None:
        """A sentence about what is not ready yet; None when all is."""
        return self._missing

    def close(self) -> None:
        """Waits for the compiler: cut off in its work, it can crash the interpreter's exit. 5 s at most."""
        self._thread.join(_LIMIT)

    def _run(self) -> None:
        try:
            self._compile()
        except Exception as error:  # shown by /readyz: the coordinator answers, but is never ready
            log.exception("the learner's kernels do not compile")
            self._missing = f"the learner's kernels do not compile: {error}"
        else:
            self._missing = None
