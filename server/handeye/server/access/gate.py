"""Who asks, may they, and not too often: decided from a request's head alone."""

from __future__ import annotations

import math
import time
from datetime import UTC, datetime

from handeye.server.access.limits import HEAD_BYTES, WINDOW, Bucket, LimitSettings, WrongTokens, size
from handeye.server.access.roles import STOP, needed_role
from handeye.server.access.tokens import Token, Tokens
from handeye.server.problem import (
    Forbidden,
    HeadTooLarge,
    Malformed,
    TokenExpired,
    TokenWrong,
    TooManyRequests,
    Unauthenticated,
)


class Gate:
    """Lets requests in or says why not. For one thread, the event loop's."""

    def __init__(self, tokens: Tokens, limits: LimitSettings) -> None:
        self._tokens = tokens
        self._limits = limits
        self._wrong = WrongTokens(limits.wrong_tokens)
        self._buckets: dict[str, Bucket] = {}

    def admit(self, method: str, path: str, authorization: bytes, address: str) -> Token | None:
        """The token of who asks; None where none is needed. Raises what the caller is told otherwise."""
        needed = needed_role(method, path)
        if needed is None:
            return None
        now = time.monotonic()
        token = self._identify(authorization, address, now)
        if (method, path) != STOP:
            self._hold_back(token, now)
        if not token.role.covers(needed):
            raise Forbidden(f"This needs the role {needed}, the token '{token.name}' has {token.role}.")
        return token

    def _identify(self, authorization: bytes, address: str, now: float) -> Token:
        scheme, _, secret = authorization.partition(b" ")
        secret = secret.strip()
        if scheme.lower() != b"bearer" or not secret:
            raise Unauthenticated("Send the header 'Authorization: Bearer <token>'.")
        token = self._tokens.find(secret)
        wait = self._wrong.wait(address, now)
        if wait and (token is None or address not in token.addresses):
            raise TooManyRequests(
                f"{self._limits.wrong_tokens} wrong tokens came from {address} within {WINDOW:g} s; "
                f"it may try again in {wait} s.",
                wait,
            )
        if token is None:
            self._wrong.note(address, now)
            raise TokenWrong(
                "Nobody has this token: it was never made, or it was revoked. An admin makes tokens by POST /v1/tokens."
            )
        if token.expires is not None and token.expired():
            end = datetime.fromtimestamp(token.expires, UTC).isoformat(timespec="seconds")
            raise TokenExpired(f"This token expired at {end}. An admin makes tokens by POST /v1/tokens.")
        token.used_from(address)
        return token

    def _hold_back(self, token: Token, now: float) -> None:
        rate = self._limits.requests_per_second
        bucket = self._buckets.get(token.id)
        if bucket is None:
            bucket = self._buckets[token.id] = Bucket(rate, now)
        if wait := bucket.take(now):
            raise TooManyRequests(
                f"The token '{token.name}' may make {rate:g} requests per second; try again in {math.ceil(wait)} s, "
                "or send several samples or queries in one request.",
                math.ceil(wait),
            )


def check_head(path: str, query: bytes, length: int) -> None:
    """Raises for a request whose head is too large (`length` in bytes), or names what no name can be."""
    if length > HEAD_BYTES:
        raise HeadTooLarge(
            f"Path, query and headers have {size(length)} together, {size(HEAD_BYTES)} is the most that is taken."
        )
    if "\0" in path or b"%00" in query:
        raise Malformed("Path and query may not have NUL characters (%00).")
    if "\N{REPLACEMENT CHARACTER}" in path:
        raise Malformed("The path is not UTF-8: percent-encode names as UTF-8.")
