"""A real bus; cameras and head are fakes unless a test says otherwise."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from handeye.rpc import Bus, BusSettings
from tests.contract.camera_fixtures import free_endpoint


@pytest.fixture
def join() -> Iterator[Callable[[str], Bus]]:
    """Joins a bus under a name; left at the end of the test."""
    settings = BusSettings(endpoint=free_endpoint())
    with ExitStack() as stack:
        stack.enter_context(Bus.host(settings, {}))
        yield lambda name: stack.enter_context(Bus.open(settings, name))
