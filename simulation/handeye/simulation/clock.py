"""The realtime clock: a thread that steps the world as the machine's clock goes."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from handeye.simulation.scene import STEP

_GREATEST_LAG = 0.25  # s that the clock may be behind before it gives up catching up


class RealtimeClock:
    """Calls `step` 240 times a second, from a thread of its own, until `close`.

    A machine that is too slow falls behind; world time then lags rather than hurrying. What `step` raises ends the
    clock and goes to `on_failure`.
    """

    def __init__(self, step: Callable[[], None], on_failure: Callable[[Exception], None]) -> None:
        self._step = step
        self._on_failure = on_failure
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="world-clock", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stops the clock and waits for its thread."""
        self._closing.set()
        self._thread.join()

    def _run(self) -> None:
        start, done = time.monotonic(), 0
        try:
            while not self._closing.is_set():
                lead = done * STEP - (time.monotonic() - start)
                if lead > 0:
                    self._closing.wait(lead)
                    continue
                if lead < -_GREATEST_LAG:
                    start, done = time.monotonic(), 0
                self._step()
                done += 1
        except Exception as error:
            self._on_failure(error)
