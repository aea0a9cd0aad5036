"""Health: is the process alive, and can it work? The only routes without a token. And what it counts, with one."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse, PlainTextResponse
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest

from handeye.server.problem_responses import just, respond, responses
from handeye.server.routes import CoordinatorDep, LanesDep
from handeye.server.schemas.service import Health

router = APIRouter(tags=["health"])


@router.get("/healthz")
async def healthz() -> Health:
    """The process answers."""
    return Health()


@router.get("/readyz", response_model=Health, responses=just(503))
async def readyz(coordinator: CoordinatorDep, lanes: LanesDep) -> Health | JSONResponse:
    """The bus, the robot bridge and the camera bridge can be reached, and the kernels are compiled."""
    if missing := await lanes.health.run(coordinator.missing):
        return respond(503, f"Not ready: {'; '.join(missing)}.", "not_ready", missing=missing)
    return Health()


@router.get("/metrics", response_class=PlainTextResponse, responses=responses())
def metrics(request: Request) -> PlainTextResponse:
    """What the server counts, as Prometheus reads it: requests, queries, samples, calls, frames, motions, jobs."""
    counted = generate_latest(request.app.state.access.metrics.registry)
    return PlainTextResponse(counted, media_type=CONTENT_TYPE_LATEST)
