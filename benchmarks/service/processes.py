"""The real server, and one that does nothing behind the same middleware, each in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from handeye.cli.up import LOOPBACK, free_ports
from handeye.client import Client, HandeyeError
from handeye.rpc import Bus, BusSettings

TOKEN = "a-token-for-the-benchmark"
LIMIT = 120.0  # s


@dataclass(frozen=True)
class Running:
    """A process that answers HTTP."""

    port: int
    pid: int

    @property
    def url(self) -> str:
        return f"http://{LOOPBACK}:{self.port}"

    def resident(self) -> float:
        """Its memory in MB."""
        for line in Path(f"/proc/{self.pid}/status").read_text().splitlines():
            if line.startswith("VmRSS"):
                return float(line.split()[1]) / 1024
        raise AssertionError("no VmRSS")


@contextmanager
def server(folder: Path) -> Iterator[Running]:
    """`handeye server` with an empty store in `folder`, on a bus without bridges: modules need none."""
    (bus_port, port) = free_ports(2)
    settings = BusSettings(endpoint=f"tcp/{LOOPBACK}:{bus_port}")
    environment = os.environ | {
        "HANDEYE_BUS_ENDPOINT": settings.endpoint,
        "HANDEYE_SERVER_PORT": str(port),
        "HANDEYE_SERVER_TOKEN": TOKEN,
        "HANDEYE_SERVER_DATA_DIR": str(folder),
        "HANDEYE_DATABASE_URL": f"sqlite:///{folder / 'handeye.db'}",
        # One token makes all the load.
        "HANDEYE_SERVER_LIMITS__REQUESTS_PER_SECOND": "1e9",
    }
    command = [sys.executable, "-m", "handeye.cli.main", "server", "--watch-parent"]
    with Bus.host(settings, {}, name="router"), _process(command, environment, folder / "server.log") as process:
        running = Running(port, process.pid)
        with Client(running.url, TOKEN) as client:
            _wait(process, lambda: _loaded(client))
        yield running


@contextmanager
def nothing(folder: Path) -> Iterator[Running]:
    """A FastAPI application whose one endpoint does nothing, behind the service's middleware."""
    (port,) = free_ports(1)
    command = [sys.executable, "-m", "benchmarks.service.nothing", str(port), str(folder / "nothing.db")]
    with _process(command, dict(os.environ), folder / "nothing.log") as process:
        with Client(f"http://{LOOPBACK}:{port}", TOKEN) as client:
            _wait(process, lambda: _answers(client))
        yield Running(port, process.pid)


@contextmanager
def _process(command: list[str], environment: dict[str, str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
    with log.open("wb") as sink:
        process = subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=sink, stderr=sink)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(20.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        assert process.stdin is not None
        process.stdin.close()


def _wait(process: subprocess.Popen[bytes], ready: object) -> None:
    deadline = time.monotonic() + LIMIT
    while not ready():  # type: ignore[operator]
        assert process.poll() is None, "the process has ended"
        assert time.monotonic() < deadline, "the process did not become ready"
        time.sleep(0.05)


def _answers(client: Client) -> bool:
    try:
        client.not_ready()
    except HandeyeError:
        return False
    return True


def _loaded(client: Client) -> bool:
    """Only the bridges are missing, which nobody here wants."""
    try:
        missing = client.not_ready() or ""
    except HandeyeError:
        return False
    return "kernels" not in missing and "modules" not in missing and "started" not in missing
