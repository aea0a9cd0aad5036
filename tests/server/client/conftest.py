"""The Python client over a real connection: synchronous and asynchronous."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import pytest

from handeye.client import (
    AsyncClient,
    Client,
)
from tests.client.blocking import Blocking
from tests.server.conftest import TOKEN

TIMEOUT = 10.0
"""s that the client waits at most."""


@pytest.fixture(autouse=True)
def own_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Backups are made in a folder of the test's."""
    monkeypatch.setenv("HANDEYE_SERVER_DATA_DIR", str(tmp_path / "data"))


@pytest.fixture(params=["sync", "async"])
def client(request: pytest.FixtureRequest, url: str) -> Iterator[Client]:
    if request.param == "sync":
        with Client(url, TOKEN, TIMEOUT) as client:
            yield client
        return
    with asyncio.Runner() as runner, Blocking(AsyncClient(url, TOKEN, TIMEOUT), runner) as client:
        yield cast("Client", client)
