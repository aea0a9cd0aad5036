"""For all tests: whatever a test starts, it ends. A thread or a child process left behind fails the test."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import structlog

GRACE = 3.0  # s; threads that were told to end may need a moment


def _children() -> set[int]:
    """Process ids of this process's living children (zombies are dead, their parent just has not looked)."""
    found = set()
    for task in Path(f"/proc/{os.getpid()}/task").iterdir():
        try:
            children = (task / "children").read_text().split()
        except OSError:
            continue
        for child in children:
            try:
                state = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[0]
            except OSError:
                continue
            if state != "Z":
                found.add(int(child))
    return found


def _threads() -> set[threading.Thread]:
    # Dummy threads stand for threads of native libraries (Zenoh's callbacks) that once ran Python.
    return {t for t in threading.enumerate() if not isinstance(t, threading._DummyThread)}


@pytest.fixture(autouse=True, scope="session")
def plain_tracebacks() -> None:
    """The pretty ones take seconds in a test that makes many errors, and a control lease is over by then."""
    renderer = structlog.dev.ConsoleRenderer(colors=False, exception_formatter=structlog.dev.plain_traceback)
    structlog.configure(processors=[*structlog.get_config()["processors"][:-1], renderer])


@pytest.fixture(autouse=True)
def nothing_left_running() -> Iterator[None]:
    """Fails a test that leaves a thread or a process running."""
    threads, children = _threads(), _children()
    yield
    deadline = time.monotonic() + GRACE
    while (_threads() - threads or _children() - children) and time.monotonic() < deadline:
        time.sleep(0.02)
    left = [t.name for t in _threads() - threads] + [f"process {pid}" for pid in _children() - children]
    assert not left, f"the test left these running: {left}"
