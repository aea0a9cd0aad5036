"""What differs between waiting in a thread and in a task: the only code that exists twice by hand.

The synchronous client is made from the asynchronous one, word by word (`tools/make_sync.py`), and these are the words.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Awaitable, Callable

async_sleep = asyncio.sleep
sync_sleep = time.sleep


class AsyncBeats:
    """Awaits `beat` every `period` s in a task of its own, until that returns False or `stop`."""

    def __init__(self, beat: Callable[[], Awaitable[bool]], period: float) -> None:
        self._beat = beat
        self._period = period
        self._task: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Begins."""
        self._task = asyncio.create_task(self._run())

    async def stop(self) -> None:
        """Ends; returns when nothing of it goes on."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])

    async def _run(self) -> None:
        while await self._beat():
            await asyncio.sleep(self._period)


class SyncBeats:
    """Calls `beat` every `period` s in a thread of its own, until that returns False or `stop`."""

    def __init__(self, beat: Callable[[], bool], period: float) -> None:
        self._beat = beat
        self._period = period
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="control-lease", daemon=True)

    def start(self) -> None:
        """Begins."""
        self._thread.start()

    def stop(self) -> None:
        """Ends; returns when nothing of it goes on."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        while not self._stopped.is_set() and self._beat():
            self._stopped.wait(self._period)
