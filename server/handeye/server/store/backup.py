"""Writes a whole store as one SQLite file while it is in use, and puts such a file's contents in its place again."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import quote

from alembic.util import CommandError
from sqlalchemy import Connection, Engine, Table, delete, insert, select
from sqlalchemy.exc import DBAPIError

from handeye.server.store.check import examine, version
from handeye.server.store.engine import Store, StoreError, connect, explain, parse
from handeye.server.store.reading import Unreadable, Watch, reading, rows_of, unwatched
from handeye.server.store.rows import seal
from handeye.server.store.tables import counters, metadata, modules, set_aside, tokens
from handeye.server.store.upgrade import newest, upgrade

_AT_ONCE = 1000  # rows in one statement
_KEPT = (tokens, set_aside)


class BackupError(StoreError):
    """The file cannot be restored; the message is a clause without capital and full stop."""


def backup(store: Store, path: Path) -> None:
    """Writes the store as it is now to a file `path`, in place of one that is there; others go on writing.

    `StoreError` when it cannot be read or written; then `path` is as it was.
    """
    new = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        new.unlink(missing_ok=True)
        new.touch(0o600)
        if store.engine.dialect.name == "sqlite":
            _copy_file(Path(str(store.engine.url.database)), new)
        else:
            _copy_rows(store.engine, new)
        with new.open("rb") as written:
            os.fsync(written.fileno())
        new.replace(path)
    except (DBAPIError, sqlite3.Error, OSError) as error:
        raise StoreError(f"the store cannot be backed up to {path}: {_reason(store.engine, error)}") from error
    finally:
        for suffix in ("", "-wal", "-shm", "-journal"):
            Path(f"{new}{suffix}").unlink(missing_ok=True)


def _copy_file(source: Path, target: Path) -> None:
    with closing(sqlite3.connect(f"file:{quote(str(source.absolute()))}?mode=ro", uri=True)) as connection:
        connection.execute("VACUUM INTO ?", (str(target),))


def _copy_rows(source: Engine, target: Path) -> None:
    with _new_store(target) as written, reading(source.url) as connection:
        for table in metadata.sorted_tables:
            _insert(written, table, rows_of(connection, table))


@contextmanager
def _new_store(path: Path) -> Iterator[Connection]:
    """A transaction in a new store, which is one whole file at the end."""
    engine = connect(parse(f"sqlite:///{path}"))
    try:
        upgrade(engine)
        with engine.connect().execution_options(handeye_write=True) as connection, connection.begin():
            yield connection
    finally:
        engine.dispose()
    with closing(sqlite3.connect(path)) as plain:
        plain.execute("PRAGMA journal_mode=DELETE")


def restore(store: Store, path: Path, watch: Watch = unwatched) -> None:
    """Replaces what is in the store by what is in a backup, in one transaction. Tokens stay, and what was set aside.

    Numbers that were given since the backup are not given again. Whoever holds contents of the store in memory reads
    them anew. `BackupError` when the file is no backup, damaged, or from a newer handeye; then nothing has changed.
    """
    with TemporaryDirectory(prefix=".restore-", dir=path.parent) as folder:
        source = parse(f"sqlite:///{_current(path, Path(folder))}")
        try:
            findings = examine(source, watch).findings
        except StoreError as error:
            raise BackupError(str(error)) from error
        if findings:
            raise BackupError(
                f"the backup is damaged ({findings[0]}; {len(findings)} findings in all); save it as a file, and mend "
                "that by `handeye repair --database-url sqlite:////folder/file`"
            )
        try:
            with reading(source) as connection, store.write() as target:
                _replace(connection, target, watch)
        except DBAPIError as error:
            raise StoreError(f"{explain(store.engine.url, error)}; nothing was changed") from error


def _current(path: Path, folder: Path) -> Path:
    """The backup in the present form: of an older one, a migrated copy."""
    if not path.stat().st_size:
        raise BackupError("the backup is empty")
    try:
        with reading(parse(f"sqlite:///{path}")) as connection:
            revision = version(connection)
    except Unreadable as error:
        raise BackupError(f"the backup is none, or damaged where it begins: {error.reason}") from error
    if revision in (None, newest()):
        return path
    copy = folder / "copy.db"
    shutil.copyfile(path, copy)
    engine = connect(parse(f"sqlite:///{copy}"))
    try:
        upgrade(engine)
    except CommandError as error:
        raise BackupError(f"the backup is of version {revision!r}, which this handeye does not know") from error
    except DBAPIError as error:
        raise BackupError(f"the backup is damaged ({error.orig})") from error
    finally:
        engine.dispose()
    return copy


def _replace(source: Connection, target: Connection, watch: Watch) -> None:
    given = dict(target.execute(select(counters.c.name, counters.c.next)).all())
    sizes = dict(target.execute(select(modules.c.name, modules.c.next_number)).all())
    known = set(target.execute(select(set_aside.c.id)).scalars())
    for table in reversed(metadata.sorted_tables):
        if table not in _KEPT:
            target.execute(delete(table))
    for table in metadata.sorted_tables:
        rows = rows_of(source, table, watch)
        if table is counters:
            restored = {row["name"]: row["next"] for row in rows}
            names = {**given, **restored}
            rows = iter(
                seal(table, {"name": name, "next": max(given.get(name, 0), restored.get(name, 0))}) for name in names
            )
        elif table is modules:
            rows = (
                seal(table, {**row, "next_number": max(row["next_number"], sizes.get(row["name"], 0))}) for row in rows
            )
        elif table is set_aside:
            rows = (row for row in rows if row["id"] not in known)
        if table is not tokens:
            _insert(target, table, rows)


def _insert(connection: Connection, table: Table, rows: Iterator[dict[str, Any]]) -> None:
    while some := list(islice(rows, _AT_ONCE)):
        connection.execute(insert(table), some)


def _reason(engine: Engine, error: Exception) -> str:
    if isinstance(error, DBAPIError):
        return explain(engine.url, error)
    hint = "; look at the store with `handeye verify`" if isinstance(error, sqlite3.DatabaseError) else ""
    return f"{error}{hint}"
