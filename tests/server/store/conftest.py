"""Stores for the tests, in SQLite and in PostgreSQL."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from handeye.server.store import Store
from tests.server.store.example import fill
from tests.server.store.postgres import Postgres, binaries, postgres, postgres_url

__all__ = ["postgres", "postgres_url"]


@pytest.fixture(scope="session", autouse=True)
def started_first(request: pytest.FixtureRequest) -> None:
    """PostgreSQL runs before a test takes stock of what runs, since `url` asks for it late."""
    if binaries() is not None and any("[postgres" in item.nodeid for item in request.session.items):
        request.getfixturevalue("postgres")


@pytest.fixture
def sqlite_url(tmp_path: Path) -> str:
    """Where no store is yet."""
    return f"sqlite:///{tmp_path / 'store.db'}"


@pytest.fixture(params=["sqlite_url", "postgres_url"])
def url(request: pytest.FixtureRequest) -> str:
    """Of an empty database of each kind."""
    found: str = request.getfixturevalue(request.param)
    return found


@pytest.fixture
def store(url: str) -> Iterator[Store]:
    """An open, empty store of each kind."""
    with Store.open(url) as opened:
        yield opened


@pytest.fixture(scope="session")
def sqlite_example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of a closed store with rows of every kind, to be copied."""
    path = tmp_path_factory.mktemp("example") / "store.db"
    with Store.open(f"sqlite:///{path}") as opened:
        fill(opened)
    return path


@pytest.fixture(scope="session")
def postgres_example(postgres: Postgres) -> str:
    """The same in a database."""
    url = postgres.make_database()
    with Store.open(url) as opened:
        fill(opened)
    return url


@pytest.fixture(params=["sqlite", "postgres"])
def filled(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """The URL of a closed store with rows of every kind, in each kind of database."""
    if request.param == "sqlite":
        shutil.copy(request.getfixturevalue("sqlite_example"), tmp_path / "filled.db")
        yield f"sqlite:///{tmp_path / 'filled.db'}"
        return
    example, server = request.getfixturevalue("postgres_example"), request.getfixturevalue("postgres")
    url = server.make_database(example)
    yield url
    server.drop_database(url)


@pytest.fixture(scope="class")
def sqlite_store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    """An open SQLite store for all tests of a class."""
    with Store.open(f"sqlite:///{tmp_path_factory.mktemp('store') / 'store.db'}") as opened:
        yield opened
