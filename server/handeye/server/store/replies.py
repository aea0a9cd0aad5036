"""What was answered to requests with an Idempotency-Key, so that a repeated one is answered and not done again."""

from __future__ import annotations

from typing import NamedTuple

from sqlalchemy import Connection, delete

from handeye.server.store.rows import add, find, now
from handeye.server.store.tables import replies

_KEPT = 24 * 3600.0
"""Seconds for which a reply is remembered."""


class Reply(NamedTuple):
    """An answer to a write."""

    status: int
    location: str | None
    body: str
    """JSON."""


class Remembered(NamedTuple):
    """A reply, and what was asked."""

    fingerprint: str
    reply: Reply


def remembered(connection: Connection, key: str) -> Remembered | None:
    """The reply to the request with that key; None when there was none in the last day."""
    row = find(connection, replies, key)
    if row is None or row["created"] < now() - _KEPT:
        return None
    return Remembered(row["fingerprint"], Reply(row["status"], row["location"], row["body"]))


def remember(connection: Connection, key: str, fingerprint: str, reply: Reply) -> None:
    """Writes a reply down, in the transaction of what it replies to; forgets those of yesterday."""
    connection.execute(delete(replies).where(replies.c.created < now() - _KEPT))
    add(
        connection,
        replies,
        key=key,
        fingerprint=fingerprint,
        status=reply.status,
        location=reply.location,
        body=reply.body,
        created=now(),
    )
