"""What surrounds every request: its id, admission and bounds, its line in the log, its count, its error if it has one.

One piece of ASGI middleware does it all, because each further one would cost every request a few microseconds.
"""

from __future__ import annotations

import itertools
import re
import secrets
from time import perf_counter
from urllib.parse import quote

import structlog
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from structlog.contextvars import bind_contextvars, reset_contextvars

from handeye.server.access.gate import Gate, check_head
from handeye.server.access.limits import LimitSettings, size
from handeye.server.access.roles import OPEN_PATHS, body_limit
from handeye.server.access.tokens import Token
from handeye.server.metrics import Metrics
from handeye.server.problem import RequestError, TooLarge, error_sentence
from handeye.server.problem_responses import refuse, respond

CLIENT_LEFT = 499
"""The status that log and metrics have for a request whose caller left before the answer; nobody receives it."""

_QUIET = OPEN_PATHS | {"/metrics"}  # asked for all day long: logged at debug level
_PATH_LOGGED = 200  # characters
_NOSNIFF = (b"x-content-type-options", b"nosniff")
_NO_STORE = (b"cache-control", b"no-store")
_sane_id = re.compile(rb"[A-Za-z0-9._-]{1,64}").fullmatch

log = structlog.get_logger("handeye.server.access")


class _CutOff(Exception):
    """The token was revoked or expired while an answer was being sent."""


class Exchange:
    """One request and its answer on their way through."""

    __slots__ = (
        "_left",
        "_receive",
        "_send",
        "began",
        "cut_off",
        "most",
        "request_id",
        "scope",
        "status",
        "token",
        "too_large",
    )

    def __init__(self, scope: Scope, receive: Receive, send: Send, request_id: str) -> None:
        self.scope = scope
        self._receive = receive
        self._send = send
        self.request_id = request_id
        self.token: Token | None = None
        self.status = 0
        """0: the answer has not begun."""
        self.began = 0.0
        """When the answer began."""
        self.most = self._left = 0
        self.too_large = False
        self.cut_off = False

    def allow(self, most: int, declared: bytes) -> None:
        """The body may have `most` bytes; raises `TooLarge` when it is declared to have more."""
        self.most = self._left = most
        if declared.isdigit() and (len(declared) > 18 or int(declared) > most):
            raise self.larger()

    def larger(self) -> TooLarge:
        """The refusal of a body that is too large."""
        name = body_limit(self.scope["path"]).upper()
        return TooLarge(
            f"The body is larger than {size(self.most)} ({self.most} bytes), the most that is taken here: send several "
            f"requests, or raise HANDEYE_SERVER_LIMITS__{name} at the server."
        )

    async def receive(self) -> Message:
        """The next piece of the request; counts the body."""
        message = await self._receive()
        if message["type"] == "http.request":
            self._left -= len(message.get("body", b""))
            if self._left < 0:
                self.too_large = True
                raise self.larger()
        return message

    async def send(self, message: Message) -> None:
        """The next piece of the answer; the first gets the headers that all answers have."""
        if message["type"] == "http.response.start":
            if self.too_large:
                return  # what the application makes of a body that it could not read
            self.status = message["status"]
            self.began = perf_counter()
            headers = list(message.get("headers", ()))
            headers.append((b"x-request-id", self.request_id.encode()))
            headers.append(_NOSNIFF)
            if self.scope["path"].startswith("/v1") and not any(name == b"cache-control" for name, _value in headers):
                headers.append(_NO_STORE)
            message["headers"] = headers
        elif not self.status:
            return
        elif self.token is not None and message.get("more_body") and not self.token.valid():
            self.cut_off = True
            raise _CutOff
        await self._send(message)

    async def answer(self, refusal: RequestError) -> None:
        """Answers with a problem."""
        self.too_large = False
        await refuse(refusal)(self.scope, self.receive, self.send)


class AccessMiddleware:
    """Outermost of the application's middleware: nothing of a request is outside of it."""

    def __init__(self, app: ASGIApp, gate: Gate, limits: LimitSettings, metrics: Metrics) -> None:
        self._app = app
        self._gate = gate
        self._limits = limits
        self._metrics = metrics
        # Request ids: unlike those of other processes, in the order in which the requests came.
        self._prefix = secrets.token_hex(4)
        self._numbers = itertools.count(1)
        self._log = log.bind()  # put together once, not for every line

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Lets the request through, or answers itself."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            await send({"type": "websocket.close", "code": 1008})  # policy violation: there are none here
            return
        started = perf_counter()
        authorization = declared = given = b""
        length = len(scope.get("raw_path") or b"") + len(scope["query_string"])
        for name, value in scope["headers"]:
            length += len(name) + len(value)
            if name == b"authorization":
                authorization = value
            elif name == b"content-length":
                declared = value
            elif name == b"x-request-id":
                given = value
        request_id = given.decode() if _sane_id(given) else f"{self._prefix}{next(self._numbers):08x}"
        exchange = Exchange(scope, receive, send, request_id)
        before = bind_contextvars(request_id=request_id)
        try:
            await self._pass(exchange, length, authorization, declared)
        finally:
            self._record(exchange, started)
            reset_contextvars(**before)

    async def _pass(self, exchange: Exchange, length: int, authorization: bytes, declared: bytes) -> None:
        scope = exchange.scope
        path = scope["path"]
        try:
            try:
                address = scope["client"][0] if scope.get("client") else "unknown"
                exchange.token = self._gate.admit(scope["method"], path, authorization, address)
                scope.setdefault("state", {})["token"] = exchange.token  # for routes: `request.state.token`
                check_head(path, scope["query_string"], length)
                exchange.allow(getattr(self._limits, body_limit(path)), declared)
            except RequestError as refusal:
                await exchange.answer(refusal)
                return
            await self._app(scope, exchange.receive, exchange.send)
        except ClientDisconnect:
            pass  # nobody is left who could be told
        except Exception as error:
            await self._failed(exchange, error)
        else:
            if exchange.too_large and not exchange.status:
                await exchange.answer(exchange.larger())

    async def _failed(self, exchange: Exchange, error: Exception) -> None:
        """The last stop of an exception. Once the answer has begun, only breaking off tells that it is not whole."""
        if exchange.cut_off:
            log.info("answer cut off: its token does not count any more", token=exchange.token and exchange.token.name)
        elif exchange.too_large and not exchange.status:
            await exchange.answer(exchange.larger())
        else:
            log.error("request failed", exc_info=error, **_line(exchange))
            if not exchange.status:
                await respond(500, error_sentence(error), "internal")(exchange.scope, exchange.receive, exchange.send)

    def _record(self, exchange: Exchange, started: float) -> None:
        scope, status = exchange.scope, exchange.status or CLIENT_LEFT
        now = perf_counter()
        route = getattr(scope.get("route"), "path", "none")
        self._metrics.request(scope["method"], route, status, (exchange.began or now) - started)
        write = self._log.debug if scope["path"] in _QUIET else self._log.info
        write("request", **_line(exchange), status=status, ms=round((now - started) * 1000, 2))


def _line(exchange: Exchange) -> dict[str, object]:
    """What every log line about a request has; its id is bound to the context."""
    scope = exchange.scope
    # Percent-encoded, so that nothing in a path plays with a terminal.
    raw: bytes = scope.get("raw_path") or quote(scope["path"]).encode()
    return {
        "method": scope["method"],
        "path": raw[:_PATH_LOGGED].decode("ascii", "backslashreplace"),
        "token": exchange.token.name if exchange.token is not None else None,
    }
