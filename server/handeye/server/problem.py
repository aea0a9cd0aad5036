"""Errors as callers of the REST interface see them: problem+json (RFC 9457), each with a sentence that helps."""

from __future__ import annotations

from http import HTTPStatus
from typing import Any, ClassVar

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict
from starlette.exceptions import HTTPException

from handeye.modules.recognition import NotSeen
from handeye.rpc import errors

MEDIA_TYPE = "application/problem+json"


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


class RequestError(Exception):
    """A request that cannot be done, and why; the base of the coordinator's own errors."""

    status: ClassVar[int] = 400
    code: ClassVar[str] = "bad_request"


class NotFound(RequestError):
    """The thing asked for does not exist."""

    status = 404
    code = "not_found"


class Conflict(RequestError):
    """The request does not fit what is already there."""

    status = 409
    code = "conflict"


class Invalid(RequestError):
    """The request is well formed but asks for something impossible."""

    status = 422
    code = "invalid_argument"


_RPC_STATUS: dict[type[errors.RpcError], int] = {
    errors.Unavailable: 503,
    errors.DeadlineExceeded: 504,
    errors.InvalidArgument: 422,
    errors.OutOfLimits: 422,
    errors.Unreachable: 422,
    errors.Busy: 409,
    errors.Stopped: 409,
    errors.Cancelled: 409,
    # The coordinator's own credential or lease was refused by a bridge: not the caller's token.
    errors.Unauthorised: 502,
    errors.Internal: 502,
}

_RPC_CODE: dict[type[errors.RpcError], str] = {
    errors.Unavailable: "unavailable",
    errors.DeadlineExceeded: "deadline_exceeded",
    errors.InvalidArgument: "invalid_argument",
    errors.OutOfLimits: "out_of_limits",
    errors.Unreachable: "unreachable",
    errors.Busy: "busy",
    errors.Stopped: "stopped",
    errors.Cancelled: "cancelled",
    errors.Unauthorised: "unauthorised",
    errors.Internal: "bridge_failed",
}


def error_code(error: BaseException) -> str:
    """The stable name of an error, the same in a problem and in a job's `error.code`."""
    if isinstance(error, errors.RpcError):
        return _RPC_CODE.get(type(error), "bridge_failed")
    if isinstance(error, NotSeen):
        return "not_seen"
    if isinstance(error, RequestError):
        return error.code
    return "internal"


def error_sentence(error: BaseException) -> str:
    """What to tell people; an unforeseen exception's own text stays in the log."""
    if error_code(error) == "internal":
        return "The coordinator failed in a way that was not foreseen; its log has the details."
    return str(error)


def respond(
    status: int, detail: str, code: str, *, fields: list[FieldProblem] | None = None, missing: list[str] | None = None
) -> JSONResponse:
    """A problem+json response."""
    problem = Problem(
        title=HTTPStatus(status).phrase, status=status, detail=detail, code=code, fields=fields, missing=missing
    )
    headers = {"WWW-Authenticate": "Bearer"} if status == HTTPStatus.UNAUTHORIZED else None
    return JSONResponse(problem.model_dump(exclude_none=True), status, headers, MEDIA_TYPE)


def responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The `responses=` of a route: these statuses, and those that every route can give, are problems."""
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {
        status: {"description": HTTPStatus(status).phrase, "content": content}
        for status in sorted({401, 422, 500, *statuses})
    }


def picture_responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The `responses=` of a route that answers with a JPEG."""
    return {**responses(*statuses), 200: {"content": {"image/jpeg": {}}}}


def install(app: FastAPI) -> None:
    """Makes every error of `app` a problem."""

    @app.exception_handler(RequestError)
    def _request_error(_request: Request, error: RequestError) -> JSONResponse:
        return respond(error.status, str(error), error.code)

    @app.exception_handler(errors.RpcError)
    def _rpc_error(_request: Request, error: errors.RpcError) -> JSONResponse:
        return respond(_RPC_STATUS.get(type(error), 502), str(error), error_code(error))

    @app.exception_handler(NotSeen)
    def _not_seen(_request: Request, error: NotSeen) -> JSONResponse:
        return respond(422, str(error), "not_seen")

    @app.exception_handler(RequestValidationError)
    def _validation(_request: Request, error: RequestValidationError) -> JSONResponse:
        fields = [
            FieldProblem(location=".".join(str(part) for part in entry["loc"]), message=entry["msg"])
            for entry in error.errors()
        ]
        wrong = "; ".join(f"{field.location}: {field.message}" for field in fields)
        return respond(422, f"The request is not as expected: {wrong}.", "invalid_argument", fields=fields)

    @app.exception_handler(HTTPException)
    def _http(request: Request, error: HTTPException) -> JSONResponse:
        code = HTTPStatus(error.status_code).name.lower()
        detail = f"{error.detail}: {request.method} {request.url.path}."
        return respond(error.status_code, detail, code)

    @app.exception_handler(Exception)
    def _unforeseen(_request: Request, error: Exception) -> JSONResponse:
        # The HTTP server logs the traceback.
        return respond(500, error_sentence(error), "internal")
