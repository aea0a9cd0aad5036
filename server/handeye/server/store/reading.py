"""Reads stores as they are on the disk, damaged ones too. Nothing here changes anything."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy import (
    URL,
    Boolean,
    Connection,
    Engine,
    NullPool,
    Table,
    create_engine,
    event,
    select,
)
from sqlalchemy.exc import DBAPIError
from sqlalchemy.types import Float

from handeye.server.store.engine import StoreError, connect, explain
from handeye.server.store.findings import shown
from handeye.server.store.rows import checksum, kind_of

Watch = Callable[[str, int], None]
"""Is told how far long work is: the table, and how many of its rows were looked at."""

_EVERY = 1000  # rows between two calls of a `Watch`


def unwatched(_table: str, _rows: int) -> None:
    """For work that nobody watches."""


class Unreadable(StoreError):
    """The database refuses to read it; `reason` is what it says itself."""

    def __init__(self, message: str, reason: str) -> None:
        super().__init__(message)
        self.reason = reason


@contextmanager
def reading(url: URL) -> Iterator[Connection]:
    """A connection that only reads, and sees one state of the store whatever that is like; others go on writing.

    `Unreadable` when it cannot be read, `StoreError` when there is none.
    """
    engine = _file(Path(str(url.database))) if url.get_backend_name() == "sqlite" else connect(url)
    try:
        with engine.connect() as plain:
            connection = plain
            if url.get_backend_name() == "postgresql":
                connection = plain.execution_options(isolation_level="REPEATABLE READ", postgresql_readonly=True)
            with connection.begin():
                yield connection
    except DBAPIError as error:
        raise Unreadable(explain(url, error), shown(str(error.orig))) from error
    except UnicodeDecodeError as error:
        raise Unreadable(
            f"the store {url.render_as_string()} is damaged: names in it are no text", str(error)
        ) from error
    finally:
        engine.dispose()


def _file(path: Path) -> Engine:
    if not path.is_file():
        raise StoreError(f"there is no store {path}; HANDEYE_DATABASE_URL names another one")

    def opened() -> sqlite3.Connection:
        connection = sqlite3.connect(f"file:{quote(str(path.absolute()))}?mode=ro", uri=True, isolation_level=None)
        # What is no UTF-8 is to be reported with its row, not to end the reading of its table.
        connection.text_factory = decoded
        connection.execute("PRAGMA cell_size_check=ON").close()
        connection.execute("PRAGMA busy_timeout=30000").close()
        return connection

    engine = create_engine("sqlite://", creator=opened, poolclass=NullPool)
    event.listen(engine, "begin", lambda connection: connection.exec_driver_sql("BEGIN"))
    return engine


def decoded(content: bytes) -> str:
    """Text, in which bytes that are no UTF-8 stand as lone surrogates."""
    return content.decode("utf-8", "surrogateescape")


def rows_of(connection: Connection, table: Table, watch: Watch = unwatched) -> Iterator[dict[str, Any]]:
    """All rows of a table in no certain order, as the database has them: a damaged one's values may be of any type."""
    names = table.columns.keys()
    flags = [column.name for column in table.columns if isinstance(column.type, Boolean)]
    statement = str(select(table).compile(connection))
    found = connection.exec_driver_sql(statement, execution_options={"stream_results": True, "yield_per": _EVERY})
    for number, values in enumerate(found):
        row = dict(zip(names, values, strict=True))
        for name in flags:
            row[name] = _flag(row[name])
        if number % _EVERY == 0:
            watch(table.name, number)
        yield row


def row_from(table: Table, values: list[Any]) -> dict[str, Any]:
    """The row that SQLite keeps as these values: a whole number in place of a Boolean, or of a float that is whole."""
    row = {}
    for column, value in zip(table.columns, values, strict=True):
        if isinstance(column.type, Boolean):
            row[column.name] = _flag(value)
        elif isinstance(column.type, Float) and type(value) is int:
            row[column.name] = float(value)
        else:
            row[column.name] = value
    return row


def _flag(value: Any) -> Any:
    return bool(value) if type(value) is int and value in (0, 1) else value


def misfit(table: Table, row: Mapping[str, Any]) -> str | None:
    """Which value cannot be in its column, in a sentence; None when all can."""
    for name, kind, nullable in _columns(table):
        value = row[name]
        if value is None:
            if not nullable:
                return f"its {name} is missing"
        elif type(value) is not kind:
            return f"its {name} is no {_SPOKEN[kind]}"
    return None


def damage(table: Table, row: Mapping[str, Any]) -> str | None:
    """What is wrong with a row by itself, in a sentence; None when its values and its checksum fit."""
    problem = misfit(table, row)
    if problem is not None:
        return problem
    try:
        fits = checksum(table, row) == row["checksum"]
    except UnicodeEncodeError:
        return "a text in it is no UTF-8"
    return None if fits else "its checksum does not fit: some of it has changed"


_SPOKEN = {bool: "yes or no", float: "number", str: "text", bytes: "sequence of bytes", int: "whole number"}
_known: dict[Table, list[tuple[str, type, bool]]] = {}


def _columns(table: Table) -> list[tuple[str, type, bool]]:
    """(name, type, may be missing) of each column; remembered, because every row asks."""
    if table not in _known:
        _known[table] = [(column.name, kind_of(column), bool(column.nullable)) for column in table.columns]
    return _known[table]


def key_of(table: Table, row: Mapping[str, Any]) -> str:
    """A row's primary key for people: its columns with slashes between them."""
    return "/".join(shown(str(row[column.name])) for column in table.primary_key.columns)
