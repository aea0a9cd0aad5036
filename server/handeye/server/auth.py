"""Bearer tokens (RFC 6750): nothing but the health routes answers without one."""

from __future__ import annotations

import secrets

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from handeye.server.problem import respond

OPEN_PATHS = frozenset({"/healthz", "/readyz"})
"""These answer without a token."""


def new_token() -> str:
    """A fresh token of 256 random bits."""
    return secrets.token_urlsafe(32)


class BearerToken:
    """ASGI middleware that lets only callers with the token pass. The token is neither logged nor shown."""

    def __init__(self, app: ASGIApp, token: str) -> None:
        if not token:
            raise ValueError("the coordinator's token is empty: set HANDEYE_SERVER_TOKEN or leave it unset")
        self._app = app
        self._token = token.encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers 401 itself, or hands the request on."""
        if scope["type"] == "lifespan" or scope["path"] in OPEN_PATHS:
            await self._app(scope, receive, send)
            return
        scheme, _, given = Headers(scope=scope).get("authorization", "").partition(" ")
        if scheme.lower() != "bearer" or not given:
            response = respond(401, "Send the header 'Authorization: Bearer <token>'.", "token_missing")
        elif not secrets.compare_digest(given.strip().encode(), self._token):
            response = respond(
                401, "This token is not the coordinator's; it was shown when the coordinator started.", "token_wrong"
            )
        else:
            await self._app(scope, receive, send)
            return
        await response(scope, receive, send)
