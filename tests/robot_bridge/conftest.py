"""A real router and a real bus around the service; the robot is a fake unless a test says otherwise."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from handeye.rpc import Bus, BusSettings


def free_endpoint() -> str:
    """A Zenoh endpoint on loopback where nobody listens now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def router() -> Iterator[BusSettings]:
    """A bus that others can join; the settings to join it."""
    settings = BusSettings(endpoint=free_endpoint())
    with Bus.host(settings, {}):
        yield settings


@pytest.fixture
def join(router: BusSettings) -> Iterator[Callable[[str], Bus]]:
    """Joins the bus under a name; left at the end of the test."""
    with ExitStack() as stack:
        yield lambda name: stack.enter_context(Bus.open(router, name))
