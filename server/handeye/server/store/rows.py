"""Rows with checksums: a byte that flips on a disk is found by `handeye verify`, not answered with."""

from __future__ import annotations

import struct
import time
import zlib
from collections.abc import Mapping
from functools import cache
from typing import Any

import orjson
from sqlalchemy import Boolean, Connection, Float, LargeBinary, Table, Text, insert, select, update

_NONE, _FALSE, _TRUE = b"\x00", b"\x01", b"\x02"
_double = struct.Struct("<cd")
_integer = struct.Struct("<cq")
_length = struct.Struct("<cq")


def checksum(table: Table, row: Mapping[str, Any]) -> int:
    """CRC-32 of a row's columns in the table's order, without the checksum itself."""
    value = 0
    for column in table.columns.keys()[:-1]:
        value = zlib.crc32(encoded(row[column]), value)
    return value


def encoded(value: object) -> bytes:
    """One value, unmistakably: type, length where it varies, content."""
    if value is None:
        return _NONE
    if isinstance(value, bool):
        return _TRUE if value else _FALSE
    if isinstance(value, int):
        return _integer.pack(b"i", value)
    if isinstance(value, float):
        return _double.pack(b"f", value)
    content = value.encode() if isinstance(value, str) else bytes(value)  # type: ignore[call-overload]
    return _length.pack(b"s" if isinstance(value, str) else b"b", len(content)) + content


def seal(table: Table, row: Mapping[str, Any]) -> dict[str, Any]:
    """The row with its checksum; all other columns must be there.

    `TypeError` for a value that would not be read back as it was written, and so would not fit the checksum.
    """
    for name, kind in _kinds(table):
        value = row[name]
        if value is not None and (not isinstance(value, kind) or (kind is int and isinstance(value, bool))):
            raise TypeError(f"{table.name}.{name} takes {kind.__name__}, not {type(value).__name__} ({value!r})")
    return {**row, "checksum": checksum(table, row)}


@cache
def _kinds(table: Table) -> tuple[tuple[str, type], ...]:
    """Its columns but the checksum, and of what type their values are."""
    return tuple((column.name, kind_of(column)) for column in list(table.columns)[:-1])


def kind_of(column: Any) -> type:
    """The Python type of a column's values."""
    for declared, kind in ((Boolean, bool), (Float, float), (Text, str), (LargeBinary, bytes)):
        if isinstance(column.type, declared):
            return kind
    return int


def add(connection: Connection, table: Table, **row: Any) -> None:
    """Inserts one row, sealed."""
    connection.execute(insert(table), seal(table, row))


def find(connection: Connection, table: Table, *key: Any) -> dict[str, Any] | None:
    """The row of that primary key as a dictionary; None when there is none."""
    columns = list(table.primary_key.columns)
    wanted = [column == value for column, value in zip(columns, key, strict=True)]
    found = connection.execute(select(table).where(*wanted)).mappings().first()
    return None if found is None else dict(found)


def change(connection: Connection, table: Table, *key: Any, **changes: Any) -> None:
    """Changes columns of the row of that primary key and seals it anew; `KeyError` when there is none."""
    row = find(connection, table, *key)
    if row is None:
        raise KeyError(key)
    columns = list(table.primary_key.columns)
    wanted = [column == value for column, value in zip(columns, key, strict=True)]
    connection.execute(update(table).where(*wanted).values(**seal(table, {**row, **changes})))


def put(connection: Connection, table: Table, **row: Any) -> None:
    """Inserts the row, or replaces the one of its primary key."""
    key = [row[column.name] for column in table.primary_key.columns]
    if find(connection, table, *key) is None:
        add(connection, table, **row)
    else:
        change(connection, table, *key, **row)


def now() -> float:
    """The time to write into the store: s since 1970, UTC."""
    return time.time()


def dumps(value: object) -> str:
    """JSON text."""
    return orjson.dumps(value).decode()


def loads(text: str) -> Any:
    """What JSON text says."""
    return orjson.loads(text)
