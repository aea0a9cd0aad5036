from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest


def children_of(pid: int) -> set[int]:
    """The living processes whose parent is `pid`, zombies left out."""
    found = set()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                state, parent = (entry / "stat").read_text().rpartition(")")[2].split()[:2]
            except OSError:
                continue
            if int(parent) == pid and state != "Z":
                found.add(int(entry.name))
    return found


@pytest.fixture
def no_orphans() -> Callable[[], set[int]]:
    """Says which children this process has that it had not when the test began."""
    before = children_of(os.getpid())
    return lambda: children_of(os.getpid()) - before
