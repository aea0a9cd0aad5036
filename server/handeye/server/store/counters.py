"""Numbers that are given once, in the order in which they are asked for."""

from __future__ import annotations

from sqlalchemy import Connection

from handeye.server.store.rows import find, put
from handeye.server.store.tables import counters


def take(connection: Connection, name: str) -> int:
    """The next number of the counter `name`, from 1."""
    row = find(connection, counters, name)
    number = 1 if row is None else int(row["next"])
    put(connection, counters, name=name, next=number + 1)
    return number
