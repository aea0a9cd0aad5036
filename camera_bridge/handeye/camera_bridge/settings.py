"""Settings of a camera bridge."""

from __future__ import annotations

from typing import Literal

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


class CameraBridgeSettings(BaseSettings):
    """Which cameras and head the bridge owns; from the environment, prefix `HANDEYE_CAMERA_`."""

    model_config = SettingsConfigDict(env_prefix="HANDEYE_CAMERA_", extra="forbid")

    driver: Literal["simulated"] = "simulated"
    """The driver of cameras and head."""
    stream_rate: float = Field(default=5.0, gt=0.0, le=60.0)
    """Stereo pairs a second on the stream, at most, while somebody watches it."""
    lab_timeout: float = Field(default=30.0, gt=0.0)
    """Simulated: how long to wait at the start for the robot bridge's lab bus, in s."""
