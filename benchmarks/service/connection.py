"""A raw keep-alive connection: nothing of a client library is measured."""

from __future__ import annotations

import asyncio
import socket
import time

import numpy as np
from numpy.typing import NDArray

from benchmarks.service.processes import TOKEN, Running


def request(path: str, body: bytes) -> bytes:
    """A POST of JSON as it goes over the wire."""
    head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {TOKEN}\r\n"
    return f"{head}Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body


def ask_alternately(
    servers: list[Running], requests: list[bytes], rounds: int, block: int
) -> list[NDArray[np.float64]]:
    """Seconds per request for each server, asked in blocks by turns so that all see the same machine."""
    sockets = [socket.create_connection(("127.0.0.1", each.port)) for each in servers]
    for each in sockets:
        each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    took: list[list[float]] = [[] for _ in servers]
    try:
        for turn in range(rounds + 1):  # the first round warms up
            for connection, wanted, times in zip(sockets, requests, took, strict=True):
                for _ in range(block):
                    started = time.perf_counter()
                    connection.sendall(wanted)
                    _receive(connection)
                    if turn:
                        times.append(time.perf_counter() - started)
    finally:
        for each in sockets:
            each.close()
    return [np.array(times) for times in took]


def _receive(connection: socket.socket) -> None:
    answer = connection.recv(65536)
    head, _, body = answer.partition(b"\r\n\r\n")
    assert b" 200 " in head.split(b"\r\n", 1)[0], answer[:500]
    length = int(head.lower().split(b"content-length: ")[1].split(b"\r\n")[0])
    while len(body) < length:
        body += connection.recv(65536)


async def load(running: Running, wanted: bytes, clients: int, seconds: float) -> tuple[NDArray[np.float64], int]:
    """Seconds of every request that so many clients made, each the next as soon as the last was answered; errors."""
    took: list[float] = []
    errors = 0
    end = time.monotonic() + seconds

    async def client() -> None:
        nonlocal errors
        reader, writer = await asyncio.open_connection("127.0.0.1", running.port)
        try:
            while time.monotonic() < end:
                started = time.perf_counter()
                writer.write(wanted)
                head = await reader.readuntil(b"\r\n\r\n")
                length = int(head.lower().split(b"content-length: ")[1].split(b"\r\n")[0])
                await reader.readexactly(length)
                took.append(time.perf_counter() - started)
                errors += b" 200 " not in head[:20]
        finally:
            writer.close()

    await asyncio.gather(*(client() for _ in range(clients)))
    return np.array(took), errors
