"""What can be wrong with a request, as exceptions: each has a status, a stable code, and a sentence that helps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from sqlalchemy.exc import DatabaseError, InterfaceError
from sqlalchemy.exc import TimeoutError as PoolTimeout

from handeye.modules.recognition import NotSeen
from handeye.rpc import errors

_BEARER: Mapping[str, str] = {"WWW-Authenticate": "Bearer"}
_SOON: Mapping[str, str] = {"Retry-After": "1"}


class RequestError(Exception):
    """A request that cannot be done, and why; the base of the coordinator's own errors."""

    status: ClassVar[int] = 400
    code: ClassVar[str] = "bad_request"
    headers: Mapping[str, str] | None = None
    """Headers of the answer."""


class Malformed(RequestError):
    """The request cannot be read: its body, its path, a header."""

    code = "malformed"


class Unauthenticated(RequestError):
    """Nobody knows who asks; the base of what can be wrong with a token."""

    status = 401
    code = "token_missing"
    headers = _BEARER


class TokenWrong(Unauthenticated):
    """Nobody has such a token."""

    code = "token_wrong"


class TokenExpired(Unauthenticated):
    """The token was good once."""

    code = "token_expired"


class Forbidden(RequestError):
    """The token's role does not reach so far."""

    status = 403
    code = "forbidden"


class NotFound(RequestError):
    """The thing asked for does not exist."""

    status = 404
    code = "not_found"


class Conflict(RequestError):
    """The request does not fit what is already there."""

    status = 409
    code = "conflict"


class TooLarge(RequestError):
    """The body is larger than is taken."""

    status = 413
    code = "too_large"


class UnsupportedMediaType(RequestError):
    """The body is of a type that the route does not read."""

    status = 415
    code = "unsupported_media_type"


class Invalid(RequestError):
    """The request is well formed but asks for something impossible."""

    status = 422
    code = "invalid_argument"


class TooManyRequests(RequestError):
    """More requests than are taken; `retry_after` is in s."""

    status = 429
    code = "too_many_requests"

    def __init__(self, sentence: str, retry_after: int) -> None:
        super().__init__(sentence)
        self.headers = {"Retry-After": str(retry_after)}


class HeadTooLarge(RequestError):
    """Path, query and headers together are larger than is taken."""

    status = 431
    code = "head_too_large"


class NotReady(RequestError):
    """What is needed is still being prepared; soon it will be there."""

    status = 503
    code = "not_ready"
    headers = _SOON


_RPC_STATUS: dict[type[errors.RpcError], int] = {
    errors.Unavailable: 503,
    errors.DeadlineExceeded: 504,
    errors.InvalidArgument: 422,
    errors.OutOfLimits: 422,
    errors.Unreachable: 422,
    errors.Busy: 409,
    errors.Stopped: 409,
    errors.Cancelled: 409,
    errors.Slipping: 409,
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
    errors.Slipping: "slipping",
    errors.Unauthorised: "unauthorised",
    errors.Internal: "bridge_failed",
}


def rpc_status(error: errors.RpcError) -> int:
    """The status of a request that a bridge refused or failed to do."""
    return _RPC_STATUS.get(type(error), 502)


STORE_FAILURES = (DatabaseError, InterfaceError, PoolTimeout)
"""What a store raises that cannot be written or read."""


def error_code(error: BaseException) -> str:
    """The stable name of an error, the same in a problem and in a job's `error.code`."""
    if isinstance(error, errors.RpcError):
        return _RPC_CODE.get(type(error), "bridge_failed")
    if isinstance(error, NotSeen):
        return "not_seen"
    if isinstance(error, RequestError):
        return error.code
    if isinstance(error, STORE_FAILURES):
        return "store_failed"
    return "internal"


def error_sentence(error: BaseException) -> str:
    """What to tell people; an unforeseen exception's own text stays in the log."""
    if error_code(error) == "internal":
        return "The coordinator failed in a way that was not foreseen; its log has the details."
    if isinstance(error, STORE_FAILURES):
        return (
            "The store failed: its disk may be full or damaged, or its server down. The log has the details; try "
            "again, or have the store looked at by `handeye verify`."
        )
    return str(error)


def sentence(error: Exception) -> str:
    """What an error of ours says, as a sentence."""
    text = str(error)
    return f"{text[:1].upper()}{text[1:]}."
