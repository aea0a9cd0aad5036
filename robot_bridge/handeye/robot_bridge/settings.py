"""Settings of a robot bridge."""

from __future__ import annotations

from typing import Literal

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


class RobotBridgeSettings(BaseSettings):
    """Which robot the bridge owns; from the environment, prefix `HANDEYE_ROBOT_`."""

    model_config = SettingsConfigDict(env_prefix="HANDEYE_ROBOT_", extra="forbid")

    driver: Literal["simulated"] = "simulated"
    """The robot's driver."""
    clock: Literal["lockstep", "realtime"] = "lockstep"
    """Simulated: how world time passes."""
    profile: Literal["default", "ideal"] = "default"
    """Simulated: as real rigs are, or free of noise, backlash and latency."""
    seed: int = Field(default=0, ge=0)
    """Simulated: seed of everything random in the world."""
