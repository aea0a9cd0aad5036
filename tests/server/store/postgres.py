"""A real PostgreSQL server, from Debian's package, for as long as the tests run."""

from __future__ import annotations

import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psycopg
import pytest

START_LIMIT = 60.0  # s


def binaries() -> Path | None:
    """The folder of the newest server that is installed."""
    found = Path("/usr/lib/postgresql").glob("*/bin/postgres")
    newest = max(found, key=lambda path: float(path.parents[1].name), default=None)
    return None if newest is None else newest.parent


class Postgres:
    """A server with its data in `folder`, which belongs to it alone. It can be killed and started again."""

    def __init__(self, binaries: Path, folder: Path, *, durable: bool = False) -> None:
        self._binaries = binaries
        self._folder = folder
        self._durable = durable
        self._process: subprocess.Popen[bytes] | None = None
        self._databases = 0
        with socket.create_server(("127.0.0.1", 0)) as probe:
            self._port: int = probe.getsockname()[1]
        # Whatever ends the tests ends the server too. It refuses to run as root.
        self._prefix = ["setpriv", "--pdeathsig=INT"]
        if os.geteuid() == 0:
            users = {user.pw_name: user for user in pwd.getpwall()}
            user = users.get("postgres") or users["nobody"]
            os.chown(folder, user.pw_uid, user.pw_gid)
            self._prefix += [f"--reuid={user.pw_uid}", f"--regid={user.pw_gid}", "--clear-groups"]
        subprocess.run(
            [
                *(*self._prefix, str(binaries / "initdb"), "--pgdata", str(folder / "data")),
                *("--username=handeye", "--auth=trust", "--encoding=UTF8", "--locale=C", "--no-sync"),
            ],
            check=True,
            capture_output=True,
            cwd=folder,
        )

    def start(self) -> None:
        """Starts it and waits until it answers."""
        settings = {
            "listen_addresses": "127.0.0.1",
            "port": self._port,
            "unix_socket_directories": self._folder,
            "fsync": "on" if self._durable else "off",
            "shared_buffers": "32MB",
        }
        options = [word for name, value in settings.items() for word in ("-c", f"{name}={value}")]
        command = [*self._prefix, str(self._binaries / "postgres"), "-D", str(self._folder / "data"), *options]
        with (self._folder / "log").open("ab") as log:
            self._process = subprocess.Popen(command, stdout=log, stderr=log, cwd=self._folder)
        deadline = time.monotonic() + START_LIMIT
        while not self._answers():
            said = (self._folder / "log").read_text(errors="replace")[-2000:]
            assert self._process.poll() is None, f"PostgreSQL ended: {said}"
            assert time.monotonic() < deadline, f"PostgreSQL does not answer: {said}"
            time.sleep(0.05)

    def kill(self) -> None:
        """Ends all its processes at once, in whatever they do."""
        assert self._process is not None
        workers = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children").read_text().split()
        for process in [self._process.pid, *map(int, workers)]:
            os.kill(process, signal.SIGKILL)
        self._process.wait()
        while any(Path(f"/proc/{process}").exists() for process in workers):
            time.sleep(0.01)

    def stop(self) -> None:
        """Ends it in order, without waiting for who is still connected."""
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
            try:
                self._process.wait(20)
            except subprocess.TimeoutExpired:
                self.kill()

    def make_database(self, like: str = "") -> str:
        """A new database, empty or a copy of the one at the URL `like`; returns its SQLAlchemy URL."""
        self._databases += 1
        name = f"test{self._databases}"
        self._do(f"CREATE DATABASE {name} TEMPLATE {like.rpartition('/')[2] or 'template0'}")
        return f"postgresql+psycopg://handeye@127.0.0.1:{self._port}/{name}"

    def drop_database(self, url: str) -> None:
        """Drops a database, in use or not."""
        self._do(f"DROP DATABASE {url.rpartition('/')[2]} WITH (FORCE)")

    def _do(self, statement: str) -> None:
        with psycopg.connect(self._address, autocommit=True) as connection:
            connection.execute(statement.encode())

    def _answers(self) -> bool:
        try:
            psycopg.connect(self._address, connect_timeout=5).close()
        except psycopg.OperationalError:
            return False
        return True

    @property
    def _address(self) -> str:
        return f"postgresql://handeye@127.0.0.1:{self._port}/postgres"


@contextmanager
def running_postgres(*, durable: bool = False) -> Iterator[Postgres]:
    """A server, gone at the end; skips the test where none is installed. `durable`: it waits for the disk."""
    found = binaries()
    if found is None:
        pytest.skip("PostgreSQL's server is not installed: apt-get install postgresql")
    # Not in pytest's folder: the server's user could not enter it. Short: its socket is in it.
    folder = Path(tempfile.mkdtemp(prefix="handeye-postgres-"))
    try:
        server = Postgres(found, folder, durable=durable)
        try:
            server.start()
            yield server
        finally:
            server.stop()
    finally:
        shutil.rmtree(folder)


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """A server for all tests."""
    with running_postgres() as server:
        yield server


@pytest.fixture
def postgres_url(postgres: Postgres) -> Iterator[str]:
    """An empty database in it, for one test."""
    url = postgres.make_database()
    yield url
    postgres.drop_database(url)
