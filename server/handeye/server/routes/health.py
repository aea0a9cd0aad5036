"""Health: is the process alive, and can it work? The only routes without a token."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import JSONResponse

from handeye.server.problem import respond, responses
from handeye.server.routes import CoordinatorDep
from handeye.server.schemas import Health

router = APIRouter(tags=["health"])


@router.get("/healthz")
def healthz() -> Health:
    """The process answers."""
    return Health()


@router.get("/readyz", response_model=Health, responses=responses(503))
def readyz(coordinator: CoordinatorDep) -> Health | JSONResponse:
    """The bus, the robot bridge and the camera bridge can be reached, and the kernels are compiled."""
    if missing := coordinator.missing():
        return respond(503, f"Not ready: {'; '.join(missing)}.", "not_ready", missing=missing)
    return Health()
