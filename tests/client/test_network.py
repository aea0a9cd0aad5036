"""The client on a real connection to a server that behaves badly."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from handeye.client import ApiError, AsyncClient, Client, Retries, Silent, Unreachable

Behave = Callable[[socket.socket, bytes], None]
Serve = Callable[[Behave], str]

QUICK = Retries(attempts=3, first_pause=0.01, longest_pause=0.02)


@pytest.fixture
def serve() -> Iterator[Serve]:
    """Starts a server that hands each connection, with the head of its first request, to a function."""
    with contextlib.ExitStack() as opened:

        def started(behave: Behave) -> str:
            listener = opened.enter_context(socket.create_server(("127.0.0.1", 0)))
            threads: list[threading.Thread] = []

            def handle(connection: socket.socket) -> None:
                with connection, contextlib.suppress(OSError):
                    connection.settimeout(5.0)
                    behave(connection, connection.recv(65536))

            def accept() -> None:
                with contextlib.suppress(OSError):
                    while True:
                        connection, _address = listener.accept()
                        threads.append(threading.Thread(target=handle, args=(connection,)))
                        threads[-1].start()

            accepting = threading.Thread(target=accept)
            accepting.start()

            def end() -> None:
                listener.shutdown(socket.SHUT_RDWR)
                accepting.join()
                for thread in threads:
                    thread.join()

            opened.callback(end)
            return f"http://127.0.0.1:{listener.getsockname()[1]}"

        yield started


def head(status: str, *headers: str) -> bytes:
    return "\r\n".join([f"HTTP/1.1 {status}", *headers, "", ""]).encode()


def test_a_file_that_breaks_off_is_not_there(serve: Serve, tmp_path: Path) -> None:
    url = serve(lambda c, _: c.sendall(head("200 OK", "Content-Length: 1000") + b"x" * 500))
    with Client(url, retries=QUICK) as client, pytest.raises(Unreachable):
        client.backup(tmp_path / "store.db")
    assert not list(tmp_path.iterdir())


def test_a_silent_stream_is_noticed(serve: Serve) -> None:
    def silent(connection: socket.socket, _request: bytes) -> None:
        connection.sendall(head("200 OK", "Content-Type: text/event-stream", "Transfer-Encoding: chunked"))
        connection.sendall(b"8\r\n: ping\n\n\r\n")
        connection.recv(1)  # until the client goes

    url = serve(silent)
    with Client(url, retries=QUICK) as client, pytest.raises(Silent, match="does not answer in time"):
        list(client.events("j1", silence=0.2))

    async def main() -> None:
        async with AsyncClient(url, retries=QUICK) as client:
            async for _event in client.events("j1", silence=0.2):
                pass

    with pytest.raises(Silent):
        asyncio.run(main())


def test_an_upload_that_is_refused_midway_says_why(serve: Serve, tmp_path: Path) -> None:
    def refuse(connection: socket.socket, _request: bytes) -> None:
        body = b'{"title": "Content Too Large", "detail": "It is too large.", "code": "too_large"}'
        connection.sendall(head("413 Content Too Large", f"Content-Length: {len(body)}", "Connection: close") + body)
        connection.shutdown(socket.SHUT_WR)
        while connection.recv(65536):
            pass

    file = tmp_path / "m.npz"
    file.write_bytes(bytes(20 * 2**20))
    with Client(serve(refuse), retries=QUICK) as client, pytest.raises(ApiError, match="too large") as refused:
        client.import_module(file)
    assert (refused.value.status, refused.value.code) == (413, "too_large")


def test_a_connection_that_was_closed_meanwhile_is_opened_anew(serve: Serve) -> None:
    content = b'{"objects": []}'
    answer = head("200 OK", f"Content-Length: {len(content)}", "Connection: keep-alive") + content
    url = serve(lambda c, _: c.sendall(answer))
    with Client(url, retries=QUICK) as client:
        for _ in range(3):
            assert client.objects() == ()
            time.sleep(0.05)


def test_a_server_that_never_answers_is_not_waited_for(serve: Serve) -> None:
    def hold(connection: socket.socket, _request: bytes) -> None:
        connection.recv(1)  # until the client goes

    url = serve(hold)
    began = time.monotonic()
    with Client(url, timeout=0.4, retries=QUICK) as client:
        with pytest.raises(Unreachable, match="does not answer in time"):
            client.robot()
        with pytest.raises(Unreachable):
            client.create_module({"name": "m"})
    assert time.monotonic() - began < 3.0


def test_a_server_that_dies_in_mid_answer_is_asked_again(serve: Serve) -> None:
    content, count = b'{"objects": []}', 0

    def dying(connection: socket.socket, _request: bytes) -> None:
        nonlocal count
        count += 1
        whole = head("200 OK", f"Content-Length: {len(content)}") + content
        connection.sendall(whole[:-5] if count < 3 else whole)

    with Client(serve(dying), retries=QUICK) as client:
        assert client.objects() == ()
    assert count == 3
