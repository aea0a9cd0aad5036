"""Errors as callers of the REST interface see them: problem+json (RFC 9457)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict
from starlette.exceptions import HTTPException
from starlette.routing import Match

from handeye.modules.recognition import NotSeen
from handeye.rpc import errors
from handeye.server.problem import (
    STORE_FAILURES,
    Malformed,
    RequestError,
    UnsupportedMediaType,
    error_code,
    error_sentence,
    rpc_status,
    sentence,
)
from handeye.server.store.engine import StoreError

MEDIA_TYPE = "application/problem+json"

_METHODS = ("GET", "POST", "PUT", "PATCH", "DELETE")
_FIELDS_SHOWN = 20  # of a batch's thousands; whoever mends these sees the others
_SHOWN = 200  # characters of a path that a sentence repeats

log = structlog.get_logger(__name__)


class FieldProblem(BaseModel):
    """One wrong field of a request: where it stands and what is wrong with it."""

    location: str
    message: str


class Problem(BaseModel):
    """RFC 9457, with `code` (stable, for programs), `fields` (a 422's) and `missing` (a 503's of /readyz)."""

    model_config = ConfigDict(extra="forbid")

    type: str = "about:blank"
    title: str
    status: int
    detail: str
    code: str
    fields: list[FieldProblem] | None = None
    missing: list[str] | None = None


class ProblemResponse(JSONResponse):
    """A problem; it repeats what callers sent, so whatever a string can hold must not make it fail."""

    media_type = MEDIA_TYPE

    def render(self, content: Any) -> bytes:
        """The body; half a surrogate pair becomes its JSON escape."""
        return json.dumps(content, ensure_ascii=False, separators=(",", ":")).encode(errors="backslashreplace")


def respond(
    status: int,
    detail: str,
    code: str,
    *,
    fields: list[FieldProblem] | None = None,
    missing: list[str] | None = None,
    headers: Mapping[str, str] | None = None,
) -> ProblemResponse:
    """A problem+json response."""
    title = HTTPStatus(status).phrase
    problem: dict[str, Any] = {"type": "about:blank", "title": title, "status": status, "detail": detail, "code": code}
    if fields is not None:
        problem["fields"] = [field.model_dump() for field in fields]
    if missing is not None:
        problem["missing"] = missing
    return ProblemResponse(problem, status, headers)


def refuse(error: RequestError) -> ProblemResponse:
    """The response to a request that cannot be done."""
    return respond(error.status, str(error), error.code, headers=error.headers)


def just(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The `responses=` of a route that gives these statuses as problems, and no other problem."""
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {status: {"description": HTTPStatus(status).phrase, "content": content} for status in sorted({*statuses})}


def responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The `responses=` of a route: these statuses, and those that every route can give, are problems."""
    return just(400, 401, 403, 413, 415, 422, 429, 431, 500, 503, *statuses)


def picture_responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The `responses=` of a route that answers with a JPEG."""
    return {**responses(*statuses), 200: {"content": {"image/jpeg": {}}}}


# The handlers are async: plain functions would wait for one of the threads that the requests work in.
def install(app: FastAPI) -> None:
    """Makes every error of `app` a problem."""

    @app.exception_handler(RequestError)
    async def _request_error(_request: Request, error: RequestError) -> JSONResponse:
        return refuse(error)

    @app.exception_handler(errors.RpcError)
    async def _rpc_error(_request: Request, error: errors.RpcError) -> JSONResponse:
        return respond(rpc_status(error), str(error), error_code(error))

    @app.exception_handler(NotSeen)
    async def _not_seen(_request: Request, error: NotSeen) -> JSONResponse:
        return respond(422, str(error), "not_seen")

    async def _store(_request: Request, error: Exception) -> JSONResponse:
        log.error("the store failed", exc_info=error)
        return respond(503, error_sentence(error), error_code(error))

    for failure in STORE_FAILURES:
        app.add_exception_handler(failure, _store)

    @app.exception_handler(StoreError)
    async def _store_lost(_request: Request, error: StoreError) -> JSONResponse:
        log.error("the store cannot be used", exc_info=error)
        return respond(503, sentence(error), "store_failed")

    @app.exception_handler(RequestValidationError)
    async def _validation(request: Request, error: RequestValidationError) -> JSONResponse:
        return _invalid(request, error)

    @app.exception_handler(HTTPException)
    async def _http(request: Request, error: HTTPException) -> JSONResponse:
        return _framework_error(request, error)

    @app.exception_handler(Exception)
    async def _unforeseen(_request: Request, error: Exception) -> JSONResponse:
        # Only what the outermost middleware itself raises comes here; the HTTP server logs it.
        return respond(500, error_sentence(error), "internal")


def _invalid(request: Request, error: RequestValidationError) -> JSONResponse:
    entries = error.errors()
    for entry in entries:
        if entry["type"] == "json_invalid":
            position = entry["loc"][-1]  # pydantic tells it in its sentence, the standard library apart from it
            where = f" at character {position}" if isinstance(position, int) else ""
            return refuse(Malformed(f"The body is not JSON: {entry['ctx']['error']}{where}."))
        if entry["loc"] == ("body",) and isinstance(entry.get("input"), bytes):  # it was not read as JSON
            given = request.headers.get("content-type", "none")[:_SHOWN]
            wanted = "Send the body as JSON, with the header 'Content-Type: application/json'"
            return refuse(UnsupportedMediaType(f"{wanted}; its type was: {given}."))
    fields = [
        FieldProblem(location=".".join(str(part)[:_SHOWN] for part in entry["loc"]), message=entry["msg"])
        for entry in entries[:_FIELDS_SHOWN]
    ]
    wrong = "; ".join(f"{field.location}: {field.message}" for field in fields)
    more = f"; and {len(entries) - len(fields)} more" if len(entries) > len(fields) else ""
    return respond(422, f"The request is not as expected: {wrong}{more}.", "invalid_argument", fields=fields)


def _framework_error(request: Request, error: HTTPException) -> JSONResponse:
    """What Starlette and FastAPI raise: no route, no such method, a body that cannot be read."""
    status = error.status_code
    asked = f"{request.method} {request.scope['path'][:_SHOWN]}"
    if status == HTTPStatus.METHOD_NOT_ALLOWED:
        possible = ", ".join(_methods_at(request))
        return respond(
            status, f"{asked} is not possible; {possible} is.", "method_not_allowed", headers={"Allow": possible}
        )
    if status == HTTPStatus.NOT_FOUND:
        return respond(status, f"There is nothing at {asked}; GET /v1/openapi.json lists what there is.", "not_found")
    if status == HTTPStatus.BAD_REQUEST:
        why = "it is not UTF-8, is nested too deeply, or has a number of more than 4300 digits"
        return refuse(Malformed(f"The body of {asked} cannot be read as JSON: {why}."))
    return respond(status, f"{error.detail}: {asked}.", HTTPStatus(status).name.lower(), headers=error.headers)


def _methods_at(request: Request) -> list[str]:
    """The methods that the request's path has; each is a route of its own."""
    place = {"type": "http", "path": request.scope["path"], "root_path": "", "headers": []}
    routes = request.app.router.routes
    return [m for m in _METHODS if any(route.matches({**place, "method": m})[0] is Match.FULL for route in routes)]
