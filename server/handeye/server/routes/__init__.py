"""The REST routes: one module each for what a caller can name."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Request

from handeye.server.coordinator import Coordinator


def _coordinator(request: Request) -> Coordinator:
    coordinator: Coordinator = request.app.state.coordinator
    return coordinator


CoordinatorDep = Annotated[Coordinator, Depends(_coordinator)]
"""The coordinator that a route works on."""

__all__ = ["CoordinatorDep"]
