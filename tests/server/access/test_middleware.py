"""What surrounds every request: its id, its line in the log, its count; and what happens to an answer under way."""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import logging
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import structlog
from starlette.requests import Request
from starlette.responses import Response
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from handeye.rpc.process import configure_logging
from handeye.server.access import Role
from handeye.server.access.logs import Level, configure_level
from handeye.server.access.middleware import CLIENT_LEFT
from tests.server.access.conftest import ADMIN, Site, raw_request

Lines = Callable[[], list[dict[str, Any]]]


@pytest.fixture
def level() -> Level:
    return "info"


@pytest.fixture
def written(level: Level) -> Iterator[io.StringIO]:
    """Where the log goes, as the server's process writes it."""
    root = logging.getLogger()
    before, configured = (root.handlers[:], root.level), structlog.get_config()
    root.handlers = []  # pytest's own
    with contextlib.redirect_stderr(io.StringIO()) as stream:
        configure_logging()
    configure_level(level)
    yield stream
    structlog.configure(**configured)
    root.handlers, root.level = before


@pytest.fixture
def log(written: io.StringIO) -> Lines:
    """All lines of the log so far."""
    return lambda: [json.loads(line) for line in written.getvalue().splitlines()]


def request_line(lines: list[dict[str, Any]]) -> dict[str, Any]:
    [line] = [line for line in lines if line["event"] == "request"]
    return line


# Request ids


@pytest.mark.parametrize("given", ["a", "0123-abc._X", "x" * 64])
def test_a_caller_s_id_is_kept(http: TestClient, log: Lines, given: str) -> None:
    response = http.get("/v1/things/cup", headers={"X-Request-Id": given})
    assert response.headers["x-request-id"] == given
    assert {line["request_id"] for line in log()} == {given}


@pytest.mark.parametrize("given", ["", "x" * 65, "a b", 'a"b', "a\u00e9", "a/b", "{}"])
def test_an_id_that_could_do_harm_is_replaced(http: TestClient, log: Lines, given: str) -> None:
    response = http.get("/v1/things/cup", headers={b"X-Request-Id": given.encode("latin-1")})
    made = response.headers["x-request-id"]
    assert made != given
    assert len(made) == 16
    assert request_line(log())["request_id"] == made


def test_ids_are_made_and_differ(http: TestClient) -> None:
    made = {http.get(path).headers["x-request-id"] for path in ["/healthz", "/v1/things/cup", "/nowhere"] * 3}
    assert len(made) == 9


@pytest.mark.parametrize("status", [200, 401, 404, 405, 422, 500])
def test_every_answer_has_its_id(site: Site, status: int) -> None:
    http = site.client(None if status == 401 else ADMIN)
    paths = {404: "/nowhere", 405: "/v1/robot/stop", 500: "/v1/broken"}
    response = http.post("/v1/things", json={}) if status == 422 else http.get(paths.get(status, "/v1/things/cup"))
    assert response.status_code == status
    assert response.headers["x-request-id"]


def test_the_id_is_in_the_lines_of_the_work_itself(http: TestClient, log: Lines) -> None:
    http.get("/v1/things/cup", headers={"X-Request-Id": "first"})
    http.post("/v1/things", json={"name": "cup"}, headers={"X-Request-Id": "second"})
    assert [(line["event"], line["request_id"]) for line in log()] == [
        ("read", "first"),
        ("request", "first"),
        ("added in a thread", "second"),
        ("request", "second"),
    ]


def test_the_id_ends_with_its_request(site: Site) -> None:
    async def two() -> dict[str, Any]:
        await site.app(scope("/healthz"), receive, send)
        return structlog.contextvars.get_contextvars()

    async def receive() -> dict[str, Any]:
        return {"type": "http.request"}

    async def send(_message: Any) -> None:
        pass

    assert asyncio.run(two()) == {}


# Log lines


def test_one_line_for_a_request(http: TestClient, log: Lines) -> None:
    http.get("/v1/things/cup?secret=query")
    [_read, line] = log()
    assert line.pop("ms") >= 0.0
    assert line.pop("request_id")
    assert line.pop("timestamp")
    assert line == {
        "event": "request",
        "level": "info",
        "method": "GET",
        "path": "/v1/things/cup",
        "status": 200,
        "token": "configured",
    }


def test_a_refused_request_has_its_line_too(site: Site, log: Lines) -> None:
    site.client("guess").get("/v1/things/cup")
    line = request_line(log())
    assert (line["status"], line["token"]) == (401, None)


def test_nothing_in_a_path_plays_with_a_terminal(site: Site, log: Lines) -> None:
    raw_request(site, "GET", "/v1/\x1b[2J\n")
    raw_request(site, "GET", f"/v1/{'x' * 5000}")
    first, second = log()
    assert first["path"] == "/v1/%1B%5B2J%0A"
    assert len(second["path"]) == 200


@pytest.mark.parametrize(("level", "lines"), [("info", 0), ("debug", 2)])
def test_health_and_metrics_are_quiet(http: TestClient, log: Lines, lines: int) -> None:
    http.get("/healthz")
    http.get("/metrics")
    logged = log()
    assert len(logged) == lines
    assert {line["level"] for line in logged} <= {"debug"}


def test_libraries_log_like_us(log: Lines) -> None:
    logging.getLogger("uvicorn.error").warning("Invalid HTTP request %s.", "received")
    logging.getLogger("uvicorn.error").info("not this")
    try:
        1 / 0  # noqa: B018
    except ZeroDivisionError:
        logging.getLogger("asyncio").exception("failed")
    warning, error = log()
    assert (warning["event"], warning["level"], warning["logger"]) == (
        "Invalid HTTP request received.",
        "warning",
        "uvicorn.error",
    )
    assert (error["level"], error["logger"]) == ("error", "asyncio")
    assert "ZeroDivisionError" in error["exception"]


@pytest.mark.parametrize("level", ["debug"])
def test_secrets_are_in_no_log(site: Site, written: io.StringIO) -> None:
    token, viewer = site.tokens.create("guest", Role.VIEWER, None)
    secrets = [ADMIN, viewer, "the-lease-secret", "a-guessed-token", "hunter2", "local-variables-stay-out"]
    with_lease = {"Control-Lease": "the-lease-secret"}
    for secret in (ADMIN, viewer, "a-guessed-token"):
        http = site.client(secret)
        http.get("/v1/things/cup", headers=with_lease)
        http.get("/v1/things/cup?token=hunter2&lease=the-lease-secret", headers=with_lease)
        http.post("/v1/things", json={"name": "cup", "password": "hunter2"}, headers=with_lease)
        http.post("/v1/things", content=b'{"password": "hunter2", ', headers={"Content-Type": "application/json"})
        http.get("/v1/broken", headers=with_lease)
        http.get("/healthz", headers={"Authorization": f"Basic {secret}", "X-Request-Id": f"Bearer {secret}"})
    site.tokens.revoke(token.id)
    site.client(viewer).get("/v1/things/cup")
    text = written.getvalue()
    assert text.count('"request"') > 15
    assert "ZeroDivisionError" in text
    assert [secret for secret in secrets if secret in text] == []


# Metrics


def test_requests_are_counted_by_template(site: Site) -> None:
    http = site.client()
    for name in ("cup", "jug", "bowl"):
        http.get(f"/v1/things/{name}")
    http.post("/v1/things", json={})
    http.get("/nowhere/a")
    http.get("/nowhere/b")
    http.request("BREW", "/nowhere")
    site.client(None).get("/v1/things/cup")
    count = site.counted
    assert count("handeye_requests_total", method="GET", route="/v1/things/{name}", status="200") == 3
    assert count("handeye_requests_total", method="POST", route="/v1/things", status="422") == 1
    assert count("handeye_requests_total", method="GET", route="none", status="404") == 2
    assert count("handeye_requests_total", method="other", route="none", status="404") == 1
    assert count("handeye_requests_total", method="GET", route="none", status="401") == 1
    assert count("handeye_request_seconds_count", method="GET", route="/v1/things/{name}") == 3
    assert 0 < count("handeye_request_seconds_sum", method="GET", route="/v1/things/{name}") < 3


# Headers


def test_headers_of_all_answers(http: TestClient) -> None:
    for path in ("/v1/things/cup", "/v1/nothing", "/healthz", "/v1/broken"):
        headers = http.get(path).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers.get("cache-control") == ("no-store" if path.startswith("/v1") else None)


def test_an_answer_s_own_cache_control_stays(site: Site) -> None:
    @site.app.get("/v1/kept")
    def kept() -> Response:
        return Response(b"", headers={"Cache-Control": "max-age=60"})

    assert site.client().get("/v1/kept").headers.get_list("cache-control") == ["max-age=60"]


# Answers under way


def scope(path: str, method: str = "GET", secret: str = ADMIN) -> dict[str, Any]:
    headers = [(b"authorization", f"Bearer {secret}".encode())]
    return {
        "type": "http",
        "method": method,
        "path": path,
        "query_string": b"",
        "headers": headers,
        "client": ("192.0.2.7", 1),
        "root_path": "",
    }


def test_a_stream_ends_when_its_token_does(site: Site, log: Lines) -> None:
    token, secret = site.tokens.create("guest", Role.VIEWER, None)
    sent: list[Any] = []

    async def receive() -> dict[str, Any]:
        await asyncio.sleep(60)
        raise AssertionError

    async def send(message: Any) -> None:
        sent.append(message)
        if len(sent) == 5:
            site.tokens.revoke(token.id)

    async def watch() -> None:
        await asyncio.wait_for(site.app(scope("/v1/stream", secret=secret), receive, send), 10)

    asyncio.run(watch())
    assert len(sent) == 5
    assert sent[-1]["more_body"]  # it was cut off, it did not come to its end
    lines = log()
    assert [(line["level"], line["event"]) for line in lines] == [
        ("info", "answer cut off: its token does not count any more"),
        ("info", "request"),
    ]


def test_a_stream_that_fails_is_cut_off_and_logged(site: Site, log: Lines) -> None:
    sent: list[Any] = []

    async def receive() -> dict[str, Any]:
        await asyncio.sleep(60)
        raise AssertionError

    async def send(message: Any) -> None:
        sent.append(message)

    asyncio.run(site.app(scope("/v1/broken-stream"), receive, send))
    assert [message.get("body") for message in sent] == [None, b"one"]
    failed, line = log()
    assert (failed["event"], line["status"]) == ("request failed", 200)
    assert failed["request_id"] == line["request_id"]
    assert "ZeroDivisionError" in failed["exception"]


def test_who_leaves_is_no_error(site: Site, log: Lines) -> None:
    async def leaving(scope: Any, receive: Any, send: Any) -> None:
        await Request(scope, receive).body()

    site.app.mount("/v1/leaving", leaving)

    async def receive() -> dict[str, Any]:
        return {"type": "http.disconnect"}

    async def send(message: Any) -> None:
        raise AssertionError(message)

    asyncio.run(site.app(scope("/v1/leaving/", "POST"), receive, send))
    line = request_line(log())
    assert line["status"] == CLIENT_LEFT


def test_there_are_no_websockets(http: TestClient) -> None:
    with pytest.raises(WebSocketDisconnect) as closed, http.websocket_connect("/v1/things/cup"):
        pass
    assert closed.value.code == 1008
