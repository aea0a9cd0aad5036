"""Tokens: made once, shown once, known by their digest; in memory, so that no request waits for the store."""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import structlog
from pydantic import SecretStr
from sqlalchemy import delete, select

from handeye.server.access.roles import Role
from handeye.server.problem import Conflict, NotFound
from handeye.server.store import Store, rows, tables

FIRST_TOKEN_FILE = "first-token"  # noqa: S105 # a file's name
_DAY = 86400.0
_ADDRESSES = 64  # that a token remembers to have been used from

log = structlog.get_logger(__name__)


@dataclass(slots=True, eq=False)
class Token:
    """Who asks. The secret itself is nowhere. Times are in s since 1970."""

    id: str
    name: str
    role: Role
    digest: str
    created: float
    expires: float | None
    revoked: bool = False
    addresses: set[str] = field(default_factory=set)
    """From where it was used."""

    def valid(self) -> bool:
        """Neither revoked nor expired."""
        return not self.revoked and not self.expired()

    def expired(self) -> bool:
        """Its time is over."""
        return self.expires is not None and time.time() >= self.expires

    def used_from(self, address: str) -> None:
        """Remembers an address."""
        if address not in self.addresses and len(self.addresses) < _ADDRESSES:
            self.addresses.add(address)


class Tokens:
    """All tokens: those of the store, and the configured one (an admin's), which is in no store. Safe among threads."""

    def __init__(self, store: Store, configured: SecretStr | None = None) -> None:
        self._store = store
        self._configured: Token | None = None
        if configured is not None:
            secret = configured.get_secret_value()
            if not re.fullmatch("[!-~]+", secret):
                raise ValueError(
                    "HANDEYE_SERVER_TOKEN is empty, or has characters that no header can carry: set it to letters, "
                    "digits and signs, or leave it unset"
                )
            self._configured = Token("configured", "configured", Role.ADMIN, _digest(secret.encode()), 0.0, None)
        self._by_digest: dict[str, Token] = {}
        self.reload()

    def reload(self) -> None:
        """Reads the tokens anew; one whose row is damaged is left out, which the log tells."""
        with self._store.read() as connection:
            found = connection.execute(select(tables.tokens).order_by(tables.tokens.c.created)).mappings().all()
        by_digest = {}
        for row in map(dict, found):
            if rows.checksum(tables.tokens, row) == row["checksum"]:
                token = Token(row["id"], row["name"], Role(row["role"]), row["digest"], row["created"], row["expires"])
                by_digest[token.digest] = token
            else:
                log.error("a token is damaged and does not count; do `handeye verify`", token_id=row["id"])
        if self._configured is not None:
            by_digest[self._configured.digest] = self._configured
        for digest, token in self._by_digest.items():
            token.revoked = digest not in by_digest
        self._by_digest = by_digest

    def find(self, secret: bytes) -> Token | None:
        """The token of that secret, expired or not; None when there is none."""
        # How long the look-up takes tells something about a digest, which tells nothing about a secret.
        return self._by_digest.get(_digest(secret))

    def all(self) -> list[Token]:
        """The tokens of the store, the oldest first."""
        return [token for token in list(self._by_digest.values()) if token is not self._configured]

    def create(self, name: str, role: Role, days: float | None) -> tuple[Token, str]:
        """A new token, and its secret, which nobody can look up later."""
        secret = secrets.token_urlsafe(32)
        now = time.time()
        expires = None if days is None else now + days * _DAY
        token = Token(secrets.token_hex(8), name, role, _digest(secret.encode()), now, expires)
        row = {"id": token.id, "name": name, "role": role.value, "digest": token.digest}
        with self._store.write() as connection:
            rows.add(connection, tables.tokens, **row, created=now, expires=expires)
            self._store.afterwards(lambda: self._by_digest.update({token.digest: token}))
        return token, secret

    def revoke(self, token_id: str) -> None:
        """The token does not count any more, from now on, also for an answer that is still being sent.

        `NotFound` when there is none; `Conflict` for the last one of an admin: nobody could make another.
        """
        with self._store.write() as connection:
            token = next((token for token in self.all() if token.id == token_id), None)
            if token is None:
                raise NotFound(f"There is no token '{token_id}'; GET /v1/tokens lists them.")
            if token.role is Role.ADMIN and not self._has_admin(without=token):
                raise Conflict(
                    f"'{token.name}' is the last token of an admin; make another by POST /v1/tokens before it goes."
                )
            connection.execute(delete(tables.tokens).where(tables.tokens.c.id == token_id))
            self._store.afterwards(lambda: self._forget(token))

    def ensure_admin(self, show: Callable[[str], None]) -> None:
        """Makes a token for an admin when there is none; `show` gets its secret before it counts."""
        if self._has_admin():
            return
        with self._store.write():
            _token, secret = self.create("first", Role.ADMIN, None)
            show(secret)

    def _has_admin(self, without: Token | None = None) -> bool:
        tokens = list(self._by_digest.values())
        return any(token.role is Role.ADMIN and token.valid() and token is not without for token in tokens)

    def _forget(self, token: Token) -> None:
        token.revoked = True
        self._by_digest.pop(token.digest, None)


def show_first_token(secret: str, folder: Path, tell: Callable[[str], None]) -> None:
    """Tells the first token on a terminal; elsewhere, where logs are kept, only the file that has it (mode 0600)."""
    if sys.stderr.isatty():
        tell(f"The first token, an admin's, shown this once: {secret}")
        return
    path = folder / FIRST_TOKEN_FILE
    handle, fresh = tempfile.mkstemp(dir=folder, prefix=".first-token-")  # mode 0600 from the beginning
    with os.fdopen(handle, "w") as file:
        file.write(f"{secret}\n")
    os.replace(fresh, path)
    tell(f"The first token, an admin's, is in {path}: read it, keep it elsewhere, and delete the file.")


def _digest(secret: bytes) -> str:
    return hashlib.sha256(secret).hexdigest()
