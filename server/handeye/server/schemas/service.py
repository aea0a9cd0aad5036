"""The bodies that are about the service as a whole: its health, its store."""

from __future__ import annotations

from typing import Literal

from handeye.server.schemas.base import Body


class Health(Body):
    """The answer of /healthz and /readyz."""

    status: Literal["ok"] = "ok"


class Restored(Body):
    """What the store has now."""

    modules: int
    samples: int
