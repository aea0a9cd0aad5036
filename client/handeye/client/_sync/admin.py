# Made by tools/make_sync.py from client/handeye/client/_async/admin.py: change that, then `make sync`.
"""What only an administrator may do: tokens, backup, restore."""

from __future__ import annotations

from pathlib import Path

from handeye.client._foreign import parse
from handeye.client._sync.calls import SyncCalls, part
from handeye.client.models import NewToken, Restored, Role, Token, Tokens

_STORE = "application/vnd.sqlite3"


class SyncAdminCalls(SyncCalls):
    """The part of the client for /v1/tokens, /v1/backup and /v1/restore."""

    def tokens(self) -> tuple[Token, ...]:
        """All tokens, without their secrets."""
        return (self._get(Tokens, "/v1/tokens")).tokens

    def create_token(self, name: str, role: Role, days: float | None = None) -> NewToken:
        """A new token, valid for `days` or for ever; its secret is shown only here."""
        # Once and without a key: no secret is remembered for a second answer.
        return self._post(NewToken, "/v1/tokens", {"name": name, "role": role, "days": days})

    def revoke_token(self, token_id: str) -> None:
        """Makes a token worthless."""
        self._delete(f"/v1/tokens/{part(token_id)}")

    def backup(self, file: Path) -> None:
        """Writes the whole store, as it is at one moment, into a SQLite file; the coordinator goes on working."""
        self._download("/v1/backup", file)

    def restore(self, file: Path) -> Restored:
        """Replaces the whole store by a backup, all or nothing; only the tokens stay as they are.

        `ApiError` while a job is under way or somebody has control of the robot.
        """
        answer = self._upload("/v1/restore", file, _STORE)
        return parse(Restored, answer.content, self._url)
