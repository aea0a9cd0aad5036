"""Opens a store, gives transactions, and sees to it that one process at a time owns it."""

from __future__ import annotations

import fcntl
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

from alembic.util import CommandError
from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url, text
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError

from handeye.server.store.upgrade import upgrade

_BUSY_TIMEOUT = 30_000  # ms that SQLite waits for another process's write, such as a backup's checkpoint
_ADVISORY_LOCK = 0x68616E64  # any number that nobody else takes in the same database
_WRITE = "handeye_write"


class StoreError(Exception):
    """The store cannot be opened or used; the message says why and what to do."""


class StoreBusy(StoreError):
    """Another process owns the store."""


class Store:
    """An open store. What a `write` block did is durable once it is left; raising from it undoes all of it.

    Writes are exclusive within the process, and only one process has the store open. Safe among threads.
    """

    def __init__(self, engine: Engine, owner: _Owner) -> None:
        self.engine = engine
        self._owner = owner
        self._writing = threading.RLock()
        self._current: Connection | None = None
        self._callbacks: list[Callable[[], object]] = []
        self._closed = False

    @classmethod
    def open(cls, url: str) -> Store:
        """Opens the store at an SQLAlchemy URL (sqlite:///file or postgresql+psycopg://…), made or migrated as needed.

        `StoreBusy` while another process has it open, `StoreError` when it cannot be reached or is none of ours.
        """
        parsed = parse(url)
        owner = own(parsed)
        engine: Engine | None = None
        try:
            engine = connect(parsed)
            upgrade(engine)
        except BaseException as error:
            if engine is not None:
                engine.dispose()
            owner.release()
            if isinstance(error, DBAPIError):
                raise StoreError(explain(parsed, error)) from error
            if isinstance(error, CommandError):
                raise StoreError(
                    f"the store {parsed.render_as_string()} is of a version that this handeye does not know ({error}); "
                    "take a newer handeye"
                ) from error
            raise
        return cls(engine, owner)

    def close(self) -> None:
        """Closes all connections; the store may be opened elsewhere afterwards."""
        with self._writing:
            if not self._closed:
                self._closed = True
                self.engine.dispose()
                self._owner.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """A transaction that only reads, and sees one state of the store; inside a `write` of this thread, that one."""
        if self._writing_here():
            assert self._current is not None  # noqa: S101 # for the type checker
            yield self._current
            return
        with self.engine.connect() as connection, connection.begin():
            yield connection

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """A transaction that writes; nested ones join it."""
        with self._writing:
            if self._current is not None:
                yield self._current
                return
            self._owner.require()
            try:
                with self.engine.connect() as plain:
                    connection = plain.execution_options(**{_WRITE: True})
                    with connection.begin():
                        self._current = connection
                        yield connection
            except BaseException:
                self._callbacks.clear()
                raise
            finally:
                self._current = None
            callbacks, self._callbacks = self._callbacks, []
            # What one could not do is no reason to leave the others undone: the store has it all.
            failures = []
            for callback in callbacks:
                try:
                    callback()
                except Exception as error:
                    failures.append(error)
            if failures:
                raise failures[0]

    def afterwards(self, callback: Callable[[], object]) -> None:
        """Inside a `write`: calls `callback` once it is committed, before any other write begins."""
        self._callbacks.append(callback)

    def _writing_here(self) -> bool:
        if not self._writing.acquire(blocking=False):
            return False
        try:
            return self._current is not None
        finally:
            self._writing.release()


def parse(url: str) -> URL:
    """The URL, checked; `StoreError` for one that names no durable store."""
    try:
        parsed = make_url(url)
    except ArgumentError as error:
        raise StoreError(
            f"HANDEYE_DATABASE_URL looks like sqlite:////folder/handeye.db or "
            f"postgresql+psycopg://user:password@host/database ({error})"
        ) from error
    backend = parsed.get_backend_name()
    if backend == "sqlite" and parsed.database in (None, "", ":memory:"):
        raise StoreError("a store in memory would be lost at the end: name a file, sqlite:////folder/handeye.db")
    if backend == "postgresql" and parsed.drivername == "postgresql":
        parsed = parsed.set(drivername="postgresql+psycopg")
    if backend not in ("sqlite", "postgresql"):
        raise StoreError(f"the store can be SQLite or PostgreSQL, not {backend}")
    return parsed


def connect(url: URL) -> Engine:
    """An engine with our settings; nothing is read or written yet."""
    if url.get_backend_name() == "sqlite":
        path = Path(str(url.database))
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        # SQLite would let everybody read it; the files beside it get the same mode.
        path.touch(mode=0o600)
    options: dict[str, Any] = {}
    if url.get_backend_name() == "postgresql":
        # A transaction sees one state throughout, as SQLite's do.
        options = {"pool_pre_ping": True, "isolation_level": "REPEATABLE READ"}
    try:
        engine = create_engine(url, pool_size=8, max_overflow=40, **options)
    except (NoSuchModuleError, ModuleNotFoundError) as error:
        raise StoreError(f"PostgreSQL needs its driver ({error}): pip install 'handeye[postgres]'") from error
    if url.get_backend_name() == "sqlite":
        event.listen(engine, "connect", _configure)
        event.listen(engine, "begin", _begin)
    return engine


def _configure(connection: Any, _record: Any) -> None:
    """SQLite: transactions are begun by us, commits reach the disk, and damage is noticed when it is read."""
    connection.isolation_level = None
    for pragma in (
        "journal_mode=WAL",
        "synchronous=FULL",
        "foreign_keys=ON",
        # What `handeye repair` finds on a page it takes for there: what was deleted must be gone from the file.
        "secure_delete=ON",
        "cell_size_check=ON",
        f"busy_timeout={_BUSY_TIMEOUT}",
    ):
        connection.execute(f"PRAGMA {pragma}").close()


def _begin(connection: Connection) -> None:
    # A transaction that reads first and writes later could fail halfway, so writers take their lock at once.
    connection.exec_driver_sql("BEGIN IMMEDIATE" if connection.get_execution_options().get(_WRITE) else "BEGIN")


class _Owner(Protocol):
    """Owns a store for this process. The kernel or the database's server ends it for a process that died."""

    def require(self) -> None:
        """Raises `StoreBusy` when another process has taken the store meanwhile."""

    def release(self) -> None:
        """Gives the store back."""


def own(url: URL) -> _Owner:
    """Takes the store for this process; `StoreBusy` when another one has it, `StoreError` when it is out of reach."""
    return _OwnedFile(Path(f"{url.database}.lock")) if url.get_backend_name() == "sqlite" else _OwnedDatabase(url)


class _OwnedFile:
    """A file beside the store, locked for as long as it is open."""

    def __init__(self, path: Path) -> None:
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            lock = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise StoreError(f"the store's folder cannot be used: {error}") from error
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.read(lock, 32).decode(errors="replace").strip()
            os.close(lock)
            raise StoreBusy(
                f"the store {path.with_suffix('')} is in use by process {owner or 'unknown'}; end that one first"
            ) from None
        os.truncate(lock, 0)
        os.write(lock, f"{os.getpid()}\n".encode())
        self._lock = lock

    def require(self) -> None:
        """Nobody takes such a lock away."""

    def release(self) -> None:
        os.close(self._lock)


class _OwnedDatabase:
    """An advisory lock, which goes with the connection that took it."""

    def __init__(self, url: URL) -> None:
        self._url = url
        self._engine = connect(url)
        try:
            self._connection = self._taken()
        except BaseException as error:
            self._engine.dispose()
            if isinstance(error, DBAPIError):
                raise StoreError(explain(url, error)) from error
            raise

    def _taken(self) -> Connection:
        connection = self._engine.connect()
        taken = connection.execute(text("SELECT pg_try_advisory_lock(:key)"), {"key": _ADVISORY_LOCK}).scalar()
        connection.commit()
        if not taken:
            connection.close()
            raise StoreBusy(
                f"the store {self._url.render_as_string()} is in use by another process; end that one first"
            )
        return connection

    def require(self) -> None:
        if self._connection.closed or not self._alive():  # the server was started anew, or the connection cut
            self._connection.close()
            self._connection = self._taken()

    def _alive(self) -> bool:
        try:
            self._connection.execute(text("SELECT 1"))
            self._connection.commit()
        except DBAPIError:
            return False
        return True

    def release(self) -> None:
        self._connection.close()
        self._engine.dispose()


def explain(url: URL, error: DBAPIError) -> str:
    """A sentence about an error of the database, without the password of its URL."""
    reason = str(error.orig).strip().splitlines()[0] if error.orig else type(error).__name__
    hint = (
        "look at it with `handeye verify`, mend it with `handeye repair`"
        if "sqlite" in url.drivername
        else ("is the database there, and may this user use it?")
    )
    return f"the store {url.render_as_string()} cannot be used: {reason}; {hint}"
