"""The coordinator's HTTP application."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from handeye.server import problem_responses
from handeye.server.access import Access
from handeye.server.access.roles import describe
from handeye.server.coordinator import Coordinator
from handeye.server.routes import (
    Lanes,
    cameras,
    control,
    coordination,
    demonstrations,
    health,
    jobs,
    modules,
    objects,
    robot,
    samples,
    snapshots,
    store,
    tasks,
    tokens,
)
from handeye.server.schemas.samples import QueryRequest, SamplesRequest
from handeye.server.shortcut import Shortcut

# What is asked most stands first: routes are tried in this order.
_PARTS = (
    samples,
    health,
    modules,
    snapshots,
    objects,
    demonstrations,
    tasks,
    jobs,
    robot,
    control,
    coordination,
    cameras,
    tokens,
    store,
)


def create_app(coordinator: Coordinator, access: Access) -> FastAPI:
    """The application; `access` decides who may ask what of it."""
    app = routes_only()
    app.state.coordinator = coordinator
    app.state.lanes = Lanes()
    access.install(app)
    return app


def routes_only() -> FastAPI:
    """The application without anything to work on: enough for its OpenAPI document."""
    app = FastAPI(
        title="handeye coordinator",
        version="1",
        summary="Teach a robot hand-eye coordination by showing it, and run what it learned.",
        openapi_url="/v1/openapi.json",
        docs_url=None,  # the pages behind these two load scripts from elsewhere
        redoc_url=None,
        generate_unique_id_function=lambda route: route.name,  # generated clients name their calls by it
    )
    problem_responses.install(app)
    app.router.routes.append(samples.QUERY)
    # Added before access, which is outermost: nothing is answered without it.
    app.add_middleware(Shortcut, route=samples.QUERY, handlers=app.exception_handlers)
    for part in _PARTS:
        app.include_router(part.router)
    app.openapi = lambda: _openapi(app)  # type: ignore[method-assign]  # FastAPI's documented way to extend the schema
    return app


def _openapi(app: FastAPI) -> dict[str, Any]:
    """The generated schema, with the bearer token and the problem's schema, which no route names as its model."""
    if app.openapi_schema is None:
        schema = get_openapi(title=app.title, version=app.version, summary=app.summary, routes=app.routes)
        components = schema.setdefault("components", {})
        models = problem_responses.Problem.model_json_schema(ref_template="#/components/schemas/{model}")
        schemas = components.setdefault("schemas", {})
        schemas.update(models.pop("$defs", {}), Problem=models)
        # The routes that take these read the body themselves: it may also come as arrays.
        for model in (SamplesRequest, QueryRequest):
            known = model.model_json_schema(ref_template="#/components/schemas/{model}")
            schemas.update(known.pop("$defs", {}), **{model.__name__: known})
        components["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
        schema["security"] = [{"token": []}]
        describe(schema)
        app.openapi_schema = schema
    return app.openapi_schema
