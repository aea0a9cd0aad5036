"""What comes before there is a request, on a real socket."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
import uvicorn

from handeye.server.access import LimitSettings, Role
from handeye.server.access.protocol import BoundedProtocol
from handeye.server.store import Store
from tests.server.access.conftest import ADMIN, Site

LIMIT = 20.0


@pytest.fixture
def site(store: Store) -> Site:
    return Site(store, LimitSettings(body_bytes=2**20))


@pytest.fixture
def address(site: Site) -> Iterator[tuple[str, int]]:
    app = site.app
    with socket.create_server(("127.0.0.1", 0)) as listener:
        config = uvicorn.Config(app, http=BoundedProtocol, log_config=None, access_log=False, lifespan="off")
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        yield listener.getsockname()
        server.should_exit = True
        thread.join()


def ask(address: tuple[str, int], *pieces: bytes, pause: float = 0.0) -> tuple[int, dict[str, str], Any]:
    """Sends the pieces and reads one answer: status, headers, JSON."""
    with socket.create_connection(address, timeout=LIMIT) as link:
        try:
            for piece in pieces:
                link.sendall(piece)
                time.sleep(pause)
        except OSError:
            pass  # it has heard enough
        return read(link)


def read(link: socket.socket) -> tuple[int, dict[str, str], Any]:
    with link.makefile("rb") as answer:
        status = int(answer.readline().split()[1])
        headers = {}
        while line := answer.readline().strip():
            name, _, value = line.decode().partition(": ")
            headers[name.lower()] = value
        return status, headers, json.loads(answer.read(int(headers["content-length"])))


def request(line: str, *headers: str, body: bytes = b"", secret: str = ADMIN) -> bytes:
    lines = [f"{line} HTTP/1.1", "Host: here", f"Authorization: Bearer {secret}", *headers]
    return "\r\n".join(lines).encode("latin-1") + b"\r\n\r\n" + body


@pytest.mark.parametrize(
    "sent",
    [
        b"nonsense\r\n\r\n",
        b"GET /v1/things/\xff HTTP/1.1\r\nHost: here\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: here\r\nBad Header\x00: x\r\n\r\n",
        request("POST /v1/upload", "Content-Length: many"),
        request("POST /v1/upload", "Content-Length: -1"),
        request("POST /v1/upload", "Content-Length: 5", "Transfer-Encoding: chunked"),
        request("CONNECT here:80"),
    ],
)
def test_what_is_no_http_gets_a_problem_and_the_end(address: tuple[str, int], sent: bytes) -> None:
    status, headers, problem = ask(address, sent)
    assert (status, problem["status"], problem["code"]) == (400, 400, "malformed")
    assert headers["content-type"] == "application/problem+json"
    assert headers["connection"] == "close"


def test_a_head_without_end_is_refused(address: tuple[str, int]) -> None:
    head = request("GET /v1/things/cup").rstrip() + b"\r\nX-Long: "
    status, headers, problem = ask(address, head, *[b"x" * 10_000] * 100, pause=0.002)
    assert (status, problem["code"]) == (431, "head_too_large")
    assert "64 KiB" in problem["detail"]
    assert headers["connection"] == "close"


def test_a_head_that_comes_slowly_is_a_head(address: tuple[str, int]) -> None:
    pieces = [bytes([byte]) for byte in request("GET /v1/things/cup")]
    status, _headers, answer = ask(address, *pieces, pause=0.001)
    assert (status, answer["name"]) == (200, "cup")


def test_requests_after_one_another_start_anew(address: tuple[str, int]) -> None:
    long = request("GET /v1/things/cup", f"X-Long: {'x' * 50_000}")
    body = request("POST /v1/upload", "Content-Length: 500000", body=b"x" * 500_000)
    with socket.create_connection(address, timeout=LIMIT) as link:
        for sent in (long, body, long, body, long):
            for start in range(0, len(sent), 5000):
                link.sendall(sent[start : start + 5000])
            assert read(link)[0] == 200


def test_who_sends_too_much_still_gets_the_answer(address: tuple[str, int]) -> None:
    """The server reads on what it does not take, so that the caller comes to reading."""
    total = 30 * 2**20
    declared = request("POST /v1/upload", f"Content-Length: {total}")
    status, _headers, problem = ask(address, declared, b"x" * total)
    assert (status, problem["code"]) == (413, "too_large")
    chunks = [b"%x\r\n%s\r\n" % (2**20, b"x" * 2**20)] * 30
    chunked = request("POST /v1/upload", "Transfer-Encoding: chunked")
    status, _headers, problem = ask(address, chunked, *chunks, b"0\r\n\r\n")
    assert (status, problem["code"]) == (413, "too_large")
    assert "1 MiB" in problem["detail"]


def test_who_asks_first_need_not_send(address: tuple[str, int]) -> None:
    asking = request("POST /v1/upload", f"Content-Length: {30 * 2**20}", "Expect: 100-continue")
    status, _headers, _problem = ask(address, asking)
    assert status == 413


def test_a_revoked_token_s_stream_is_cut_off(site: Site, address: tuple[str, int]) -> None:
    token, secret = site.tokens.create("guest", Role.VIEWER, None)
    with socket.create_connection(address, timeout=LIMIT) as link, link.makefile("rb") as answer:
        link.sendall(request("GET /v1/stream", secret=secret))
        while answer.readline() != b"drop\n":
            pass
        site.tokens.revoke(token.id)
        rest = answer.read()  # the connection ends
    assert not rest.endswith(b"0\r\n\r\n"), "the answer looks whole"


def test_a_stream_that_fails_does_not_look_whole(address: tuple[str, int]) -> None:
    with socket.create_connection(address, timeout=LIMIT) as link, link.makefile("rb") as answer:
        link.sendall(request("GET /v1/broken-stream"))
        assert answer.read().endswith(b"3\r\none\r\n")
