"""Processes that end when they are told to."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable

import pytest

from handeye.rpc import Bus, BusSettings
from handeye.rpc.process import until_stopped

Start = Callable[..., subprocess.Popen[bytes]]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_stops(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with until_stopped() as stop:
        assert not stop.is_set()
        signal.raise_signal(number)
        assert stop.wait(2.0)
    assert signal.getsignal(number) is before


def test_the_block_may_end_by_itself() -> None:
    with until_stopped() as stop:
        assert not stop.wait(0.05)
    assert "until stopped" not in {thread.name for thread in threading.enumerate()}


@pytest.mark.system
@pytest.mark.parametrize("end", ["TERM", "INT", "parent"])
def test_router_ends_in_order(settings: BusSettings, start_router: Start, end: str) -> None:
    router = start_router(settings.endpoint, None, "--watch-parent")
    Bus.open(settings, "probe", timeout=20.0).close()
    assert router.stdin is not None
    if end == "parent":
        router.stdin.close()
        router.stdin = None
    else:
        os.write(router.stdin.fileno(), b"noise does not end it\n")
        router.send_signal(getattr(signal, f"SIG{end}"))
    assert router.wait(10.0) == 0
    assert router.stdout is not None
    assert router.stderr is not None
    assert router.stdout.read() == b""
    [line] = router.stderr.read().splitlines()
    assert json.loads(line)["event"] == "router listens"


@pytest.mark.system
def test_router_outlives_its_parent_unless_told_to_watch(settings: BusSettings, start_router: Start) -> None:
    router = start_router(settings.endpoint)
    assert router.stdin is not None
    router.stdin.close()
    router.stdin = None
    Bus.open(settings, "probe", timeout=20.0).close()
    assert router.poll() is None


@pytest.mark.system
def test_router_refuses_to_listen_off_loopback_without_credentials(start_router: Start) -> None:
    router = start_router("tcp/0.0.0.0:0")
    assert router.wait(20.0) == 1
    assert router.stderr is not None
    assert b"tcp/0.0.0.0:0 can be reached from other machines: set a user and a password" in router.stderr.read()


@pytest.mark.system
def test_logs_go_to_stderr_with_tracebacks_but_without_local_variables() -> None:
    script = """
import structlog
from handeye.rpc.process import configure_logging
configure_logging()
password = "secret"
try:
    1 / 0
except ZeroDivisionError:
    structlog.get_logger().exception("failed", cell="a")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=True, timeout=60)
    assert done.stdout == b""
    line = json.loads(done.stderr)
    assert (line["event"], line["level"], line["cell"]) == ("failed", "error", "a")
    assert "ZeroDivisionError" in line["exception"]
    assert b"secret" not in done.stderr


def test_a_process_that_does_not_end_in_order_is_ended() -> None:
    program = """
import time
from handeye.rpc import process
with process.until_stopped(watch_parent=True, grace=0.5) as stop:
    stop.wait()
    time.sleep(60)  # does not hear that it is to end
"""
    with subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE) as process:
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait(10) == 1
