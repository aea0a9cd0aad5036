"""The coordinator's HTTP application."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from handeye.server import problem
from handeye.server.auth import BearerToken
from handeye.server.coordinator import Coordinator
from handeye.server.routes import Lanes, cameras, demonstrations, health, jobs, objects, robot, tasks


def create_app(coordinator: Coordinator, token: str) -> FastAPI:
    """The application; `token` is asked of every caller but for the health routes."""
    app = FastAPI(
        title="handeye coordinator",
        version="1",
        summary="Teach a robot hand-eye coordination by showing it, and run what it learned.",
        openapi_url="/v1/openapi.json",
        docs_url=None,  # the pages behind these two load scripts from elsewhere
        redoc_url=None,
    )
    app.state.coordinator = coordinator
    app.state.lanes = Lanes()
    app.add_middleware(BearerToken, token=token)
    problem.install(app)
    for part in (health, objects, demonstrations, tasks, jobs, robot, cameras):
        app.include_router(part.router)
    app.openapi = lambda: _openapi(app)  # type: ignore[method-assign]  # FastAPI's documented way to extend the schema
    return app


def _openapi(app: FastAPI) -> dict[str, Any]:
    """The generated schema, with the bearer token and the problem's schema, which no route names as its model."""
    if app.openapi_schema is None:
        schema = get_openapi(title=app.title, version=app.version, summary=app.summary, routes=app.routes)
        components = schema.setdefault("components", {})
        models = problem.Problem.model_json_schema(ref_template="#/components/schemas/{model}")
        components.setdefault("schemas", {}).update(models.pop("$defs", {}), Problem=models)
        components["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
        schema["security"] = [{"token": []}]
        app.openapi_schema = schema
    return app.openapi_schema
