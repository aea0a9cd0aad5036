"""The coordinator's settings, from the environment: HANDEYE_SERVER_*, and HANDEYE_DATABASE_URL."""

from __future__ import annotations

import os
from pathlib import Path

from pydantic import Field, SecretStr
from pydantic_settings import BaseSettings, SettingsConfigDict

from handeye.rpc.settings import SECRETS
from handeye.server.access.limits import LimitSettings
from handeye.server.access.logs import Level
from handeye.server.acting import ActingSettings
from handeye.server.gaze import GazeSettings
from handeye.server.pursuit import PursuitSettings
from handeye.server.reach import ReachSettings


def default_data_dir() -> Path:
    """`$XDG_DATA_HOME/handeye`, else `~/.local/share/handeye`."""
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share") / "handeye"


class StoreSettings(BaseSettings):
    """Where the store is, from HANDEYE_DATABASE_URL or a file of that name in HANDEYE_SECRETS_DIR."""

    model_config = SettingsConfigDict(env_prefix="HANDEYE_", extra="forbid", frozen=True, secrets_dir=SECRETS)

    database_url: SecretStr | None = None
    """sqlite:////folder/file.db or postgresql+psycopg://user:password@host/database; None: `handeye.db` in the data
    directory."""

    def url(self, data_dir: Path) -> str:
        """The store's URL, with its password."""
        if self.database_url is not None:
            return self.database_url.get_secret_value()
        return f"sqlite:///{data_dir / 'handeye.db'}"


class ServerSettings(BaseSettings):
    """Where the coordinator listens, who may call it, and how tasks act.

    Nested settings are spelled with two underscores: `HANDEYE_SERVER_ACTING__MAX_LOOKS=12`.
    """

    model_config = SettingsConfigDict(
        env_prefix="HANDEYE_SERVER_", env_nested_delimiter="__", extra="forbid", frozen=True
    )

    host: str = "127.0.0.1"
    """Address to listen on."""
    port: int = Field(default=8000, ge=0, le=65535)
    """TCP port; 0 takes a free one."""
    token: SecretStr | None = None
    """A bearer token with the role admin. None: at the first start one is made, and shown on a terminal or written to
    the file `first-token` in the data directory; the store has the others."""
    data_dir: Path = Field(default_factory=default_data_dir)
    """Where the store is, unless HANDEYE_DATABASE_URL says otherwise, and the first token."""
    connect_timeout: float = Field(default=15.0, gt=0.0)
    """How long the start waits for the router, in s."""
    grab_timeout: float = Field(default=10.0, gt=0.0)
    """How long a picture is waited for, in s."""
    jobs_kept: int = Field(default=1000, ge=1)
    """So many newest jobs can be asked for."""
    pictures_kept: int = Field(default=20, ge=1)
    """So many newest runs keep the pictures of their looks."""
    limits: LimitSettings = LimitSettings()
    """How much and how often callers may ask."""
    log_level: Level = "info"
    """What is logged: "debug" adds who asks for health and metrics."""
    acting: ActingSettings = ActingSettings()
    """How an acting task looks and moves."""
    reaching: ReachSettings = ReachSettings()
    """How the hand is brought to a point."""
    gazing: GazeSettings = GazeSettings()
    """How the head is turned to something."""
    pursuing: PursuitSettings = PursuitSettings()
    """How the head follows something."""
