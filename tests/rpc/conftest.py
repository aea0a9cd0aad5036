"""Real routers, real servers and a link that can be cut."""

from __future__ import annotations

import gc
import json
import os
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, suppress
from pathlib import Path

import pytest

from handeye.rpc import Bus, BusSettings

ROUTER = "import typer; from handeye.rpc.verbs import register; app = typer.Typer(); register(app); app()"
SERVER = Path(__file__).with_name("server_process.py")

Start = Callable[..., "subprocess.Popen[bytes]"]
Running = AbstractContextManager["subprocess.Popen[bytes]"]


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def eventually(holds: Callable[[], bool], within: float = 5.0) -> bool:
    deadline = time.monotonic() + within
    while not holds():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    return True


@contextmanager
def process(arguments: list[str], environment: dict[str, str]) -> Iterator[subprocess.Popen[bytes]]:
    """A Python process with a pipe on its stdin; killed at the end, also when it is stopped."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("HANDEYE_")}
    command = [sys.executable, *arguments]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, env=clean | environment) as child:
        try:
            yield child
        finally:
            child.kill()


def _sockets() -> set[str]:
    found = set()
    for fd in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            target = os.readlink(f"/proc/self/fd/{fd}")
            if target.startswith("socket:"):
                found.add(target)
    return found


@pytest.fixture(autouse=True)
def no_session_left() -> Iterator[None]:
    """Fails a test that leaves a session's socket behind."""
    before = _sockets()
    yield
    gc.collect()
    assert eventually(lambda: _sockets() <= before), "a session was left open"


@pytest.fixture(name="eventually")
def eventually_() -> Callable[[Callable[[], bool]], bool]:
    """Waits up to 5 s for something to become true."""
    return eventually


def router_process(endpoint: str, credentials: dict[str, str] | None = None, *arguments: str) -> Running:
    """`handeye router` with an endpoint, credentials and arguments of the command."""
    settings = {"HANDEYE_ROUTER_LISTEN": endpoint, "HANDEYE_ROUTER_CREDENTIALS": json.dumps(credentials or {})}
    return process(["-c", ROUTER, *arguments], settings)


def server_process(endpoint: str) -> Running:
    """server_process.py as a client of an endpoint."""
    return process([str(SERVER)], {"HANDEYE_BUS_ENDPOINT": endpoint})


@pytest.fixture
def start_router() -> Iterator[Start]:
    with ExitStack() as stack:
        yield lambda *arguments: stack.enter_context(router_process(*arguments))


@pytest.fixture
def start_server() -> Iterator[Start]:
    with ExitStack() as stack:
        yield lambda endpoint: stack.enter_context(server_process(endpoint))


@pytest.fixture(scope="module")
def steady_settings() -> Iterator[BusSettings]:
    """Where a router and a server run that several tests share, because none of them hurts them."""
    settings = BusSettings(endpoint=free_endpoint())
    with router_process(settings.endpoint), server_process(settings.endpoint):
        yield settings


@pytest.fixture
def steady(steady_settings: BusSettings) -> Iterator[Bus]:
    """A client of the shared server."""
    with Bus.open(steady_settings, "caller", timeout=20.0) as bus:
        bus.wait_for("Robot", 20.0)
        yield bus


@pytest.fixture
def settings() -> BusSettings:
    return BusSettings(endpoint=free_endpoint())


@pytest.fixture
def host(settings: BusSettings) -> Iterator[Bus]:
    """A bus within this process that anybody on the machine may join."""
    with Bus.host(settings, {}) as bus:
        yield bus


@pytest.fixture
def server_bus(settings: BusSettings, host: Bus) -> Iterator[Bus]:
    with Bus.open(settings, "server") as bus:
        yield bus


@pytest.fixture
def client(settings: BusSettings, host: Bus) -> Iterator[Bus]:
    with Bus.open(settings, "client") as bus:
        yield bus


@pytest.fixture
def router(settings: BusSettings, start_router: Start) -> subprocess.Popen[bytes]:
    """A router process at the endpoint of `settings`."""
    return start_router(settings.endpoint)


@pytest.fixture
def server(settings: BusSettings, router: subprocess.Popen[bytes], start_server: Start) -> subprocess.Popen[bytes]:
    """A server process (server_process.py) behind the router process."""
    return start_server(settings.endpoint)


@pytest.fixture
def caller(settings: BusSettings, server: subprocess.Popen[bytes]) -> Iterator[Bus]:
    """A client of the server process; the service is alive."""
    with Bus.open(settings, "caller", timeout=20.0) as bus:
        bus.wait_for("Robot", 20.0)
        yield bus


class CuttableLink:
    """A TCP forwarder that can fall silent as a cut cable does: nothing passes, no connection is closed."""

    def __init__(self, target: str) -> None:
        self._target = ("127.0.0.1", int(target.rsplit(":", 1)[1]))
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._wake, self._woken = socket.socketpair()
        self._peers: dict[socket.socket, socket.socket] = {}
        self._cut = False
        self.endpoint = f"tcp/127.0.0.1:{self._listener.getsockname()[1]}"
        self._thread = threading.Thread(target=self._forward)
        self._thread.start()

    def cut(self) -> None:
        self._cut = True
        self._wake.send(b"!")

    def close(self) -> None:
        self._wake.close()
        self._thread.join()
        for end in (self._listener, self._woken, *self._peers):
            end.close()

    def _forward(self) -> None:
        while True:
            open_ends = [] if self._cut else [self._listener, *self._peers]
            for end in select.select([self._woken, *open_ends], [], [])[0]:
                if end is self._woken:
                    if not self._woken.recv(16):
                        return
                elif end is self._listener:
                    near, far = self._listener.accept()[0], socket.create_connection(self._target)
                    self._peers |= {near: far, far: near}
                elif end in self._peers:
                    self._pass_on(end)

    def _pass_on(self, end: socket.socket) -> None:
        other = self._peers[end]
        try:
            data = end.recv(65536)
            other.sendall(data)
        except OSError:
            data = b""
        if not data:
            for each in (end, other):
                del self._peers[each]
                each.close()


@pytest.fixture
def link(steady_settings: BusSettings) -> Iterator[CuttableLink]:
    """A link to the shared server's router that can be cut."""
    with closing(CuttableLink(steady_settings.endpoint)) as link:
        yield link
