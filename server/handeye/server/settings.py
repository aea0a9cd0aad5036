"""The coordinator's settings, from the environment: HANDEYE_SERVER_*."""

from __future__ import annotations

from pydantic import Field, SecretStr
from pydantic_settings import BaseSettings, SettingsConfigDict

from handeye.server.acting import ActingSettings


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
    """Bearer token of every caller; None: one is made at start and shown on stderr."""
    connect_timeout: float = Field(default=15.0, gt=0.0)
    """How long the start waits for the router, in s."""
    grab_timeout: float = Field(default=10.0, gt=0.0)
    """How long a picture is waited for, in s."""
    jobs_kept: int = Field(default=200, ge=1)
    """So many newest jobs can be asked for."""
    pictures_kept: int = Field(default=8, ge=1)
    """So many newest runs keep the pictures of their looks in memory."""
    acting: ActingSettings = ActingSettings()
    """How an acting task looks and moves."""
