"""Idempotency: a write that carries an Idempotency-Key is done once, however often it is sent."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Annotated
from urllib.parse import quote

from anyio import to_thread
from fastapi import Depends, Header, Request, Response
from pydantic import BaseModel

from handeye.server.coordinator import Coordinator
from handeye.server.problem import Conflict
from handeye.server.routes import CoordinatorDep
from handeye.server.schemas.base import Key
from handeye.server.store import replies
from handeye.server.store.replies import Reply

_MEANING = (
    "Any text of your own. A request that is repeated with the same one within a day is not done again: it gets the "
    "answer that the first one got."
)


class KeyUsed(Conflict):
    """The key came with another request before."""

    code = "idempotency_key_used"


class Once:
    """The write that a request asks for, and whether it was done before."""

    def __init__(self, coordinator: Coordinator, key: str | None, fingerprint: str) -> None:
        self._store = coordinator.store
        self._key = key
        self._fingerprint = fingerprint

    def known(self) -> Response | None:
        """The answer that this request got before; None when it was not done, or carries no key.

        `KeyUsed` when its key came with another request.
        """
        if self._key is None:
            return None
        with self._store.read() as connection:
            before = replies.remembered(connection, self._key)
        if before is None:
            return None
        if before.fingerprint != self._fingerprint:
            raise KeyUsed("This Idempotency-Key came with another request before; take a new key for a new request.")
        return _response(before.reply)

    def reply(self, work: Callable[[], tuple[BaseModel, str | None]], status: int = 201) -> Response:
        """Does `work`, which returns answer and location, unless it was done before; all in one transaction."""
        with self._store.write() as connection:
            if (before := self.known()) is not None:
                return before
            answer, location = work()
            reply = Reply(status, location, answer.model_dump_json())
            if self._key is not None:
                replies.remember(connection, self._key, self._fingerprint, reply)
        return _response(reply)


def _response(reply: Reply) -> Response:
    headers = {} if reply.location is None else {"Location": quote(reply.location)}
    return Response(reply.body, reply.status, headers, "application/json")


async def _once(
    request: Request,
    coordinator: CoordinatorDep,
    idempotency_key: Annotated[Key | None, Header(alias="Idempotency-Key", description=_MEANING)] = None,
) -> Once:
    if idempotency_key is None:
        return Once(coordinator, None, "")
    body = await request.body()
    scope = request.scope  # not its URL: that a Host header of nonsense makes fail
    asked = f"{scope['method']} {scope['path']}?".encode() + scope["query_string"] + b"\n" + body
    fingerprint = await to_thread.run_sync(lambda: hashlib.sha256(asked).hexdigest())
    # Keys are their callers' own: nobody gets another's answer.
    return Once(coordinator, f"{request.state.token.id}/{idempotency_key}", fingerprint)


OnceDep = Annotated[Once, Depends(_once)]
"""How a route does its write once."""
