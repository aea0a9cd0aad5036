"""The coordinator's process on a real bus."""

from __future__ import annotations

import os
import socket
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import httpx2
import pytest
from pydantic import SecretStr

from handeye.proto.methods import CAMERA_DESCRIBE, CAMERA_GRAB_STEREO, ROBOT_GET_STATE
from handeye.proto.v1 import camera_pb2, robot_pb2
from handeye.rpc import Bus, BusSettings
from handeye.rpc.errors import Unavailable
from handeye.server.serve import CannotListen, serve
from handeye.server.settings import ServerSettings

if TYPE_CHECKING:
    from handeye.rpc import Call, Server

LIMIT = 60.0


def free_port() -> int:
    with closing(socket.create_server(("127.0.0.1", 0))) as listener:
        port: int = listener.getsockname()[1]
        return port


@pytest.fixture
def bus_settings() -> BusSettings:
    return BusSettings(endpoint=f"tcp/127.0.0.1:{free_port()}", cell="test")


def bridges(bus: Bus) -> tuple[Server, Server]:
    """Stand-ins for the robot bridge and the camera bridge."""
    state = robot_pb2.RobotState(world_time=4.0, joints=[0.0] * 6, velocities=[0.0] * 6, point=[0.0] * 3)
    return (
        bus.serve({ROBOT_GET_STATE: lambda _request, _call: state}),
        bus.serve({CAMERA_DESCRIBE: lambda _request, _call: camera_pb2.CameraDescription(width=64, height=48)}),
    )


@pytest.fixture(autouse=True)
def own_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HANDEYE_SERVER_DATA_DIR", str(tmp_path / "data"))
    monkeypatch.delenv("HANDEYE_DATABASE_URL", raising=False)


@contextmanager
def serving(bus_settings: BusSettings, settings: ServerSettings) -> Iterator[tuple[str, list[str]]]:
    """The coordinator in a thread: its address, and what it told people before."""
    stop, listening = threading.Event(), threading.Event()
    told: list[str] = []

    def tell(sentence: str) -> None:
        told.append(sentence)
        if "listens at" in sentence:
            listening.set()

    thread = threading.Thread(target=serve, args=(settings, bus_settings, stop, tell))
    thread.start()
    try:
        assert listening.wait(LIMIT)
        yield told[-1].split()[-1], told[:-1]
    finally:
        stop.set()
        thread.join(LIMIT)
        assert not thread.is_alive()


def until(url: str, status: int) -> httpx2.Response:
    """The first answer of `url` with that status."""
    deadline = time.monotonic() + LIMIT
    while (response := httpx2.get(url, timeout=LIMIT)).status_code != status:
        assert time.monotonic() < deadline, response.text
        time.sleep(0.05)
    return response


def test_ready_when_the_bridges_are_and_not_any_more_when_one_goes(bus_settings: BusSettings, tmp_path: Path) -> None:
    with (
        Bus.host(bus_settings, {}, name="router") as bus,
        serving(bus_settings, ServerSettings(port=0)) as (url, told),
    ):
        (sentence,) = told
        path = tmp_path / "data" / "first-token"
        assert str(path) in sentence
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        token = path.read_text().strip()
        assert token not in sentence
        missing = httpx2.get(f"{url}/readyz", timeout=LIMIT).json()["missing"]
        assert any("Robot" in sentence for sentence in missing)
        assert any("Camera" in sentence for sentence in missing)
        robot, camera = bridges(bus)
        until(f"{url}/readyz", 200)
        headers = {"Authorization": f"Bearer {token}"}
        state = httpx2.get(f"{url}/v1/robot", headers=headers, timeout=LIMIT)
        assert state.json()["world_time"] == 4.0
        camera.close()
        assert [*until(f"{url}/readyz", 503).json()["missing"]] == [
            "nobody serves Camera on the bus (do `handeye router` and `handeye camera-bridge` run?)"
        ]
        robot.close()
        gone = httpx2.get(f"{url}/v1/robot", headers=headers, timeout=LIMIT)
        assert (gone.status_code, gone.json()["code"]) == (503, "unavailable")


def test_requests_that_wait_for_pictures_do_not_hold_up_the_end(bus_settings: BusSettings) -> None:
    waiting = threading.Event()

    def wait_for_picture(_request: camera_pb2.GrabStereoRequest, call: Call) -> camera_pb2.StereoPair:
        waiting.set()
        while True:
            call.check()
            time.sleep(0.01)

    def ask(url: str) -> None:
        with suppress(httpx2.HTTPError):  # the server ends first
            httpx2.get(f"{url}/v1/cameras/left/frame", headers={"Authorization": "Bearer configured"}, timeout=LIMIT)

    settings = ServerSettings(port=0, token=SecretStr("configured"), grab_timeout=LIMIT)
    with Bus.host(bus_settings, {}, name="router") as bus, bus.serve({CAMERA_GRAB_STEREO: wait_for_picture}):
        with serving(bus_settings, settings) as (url, _told):
            until(f"{url}/healthz", 200)
            callers = [threading.Thread(target=ask, args=(url,)) for _ in range(20)]
            for caller in callers:
                caller.start()
            assert waiting.wait(LIMIT)
            started = time.monotonic()
        assert time.monotonic() - started < 10.0
        for caller in callers:
            caller.join(LIMIT)
            assert not caller.is_alive()


def test_a_configured_token_is_not_shown(bus_settings: BusSettings) -> None:
    settings = ServerSettings(port=0, token=SecretStr("configured"))
    with Bus.host(bus_settings, {}, name="router"), serving(bus_settings, settings) as (url, told):
        assert told == []
        assert httpx2.get(f"{url}/v1/objects", headers={"Authorization": "Bearer configured"}).status_code == 200


def test_without_a_router_it_says_so(bus_settings: BusSettings) -> None:
    settings = ServerSettings(port=0, connect_timeout=0.3)
    with pytest.raises(Unavailable, match=bus_settings.endpoint):
        serve(settings, bus_settings, threading.Event(), lambda _sentence: None)


def test_a_taken_port_is_named(bus_settings: BusSettings) -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(CannotListen, match=f"port {port} .*HANDEYE_SERVER_PORT"):
            serve(ServerSettings(port=port), bus_settings, threading.Event(), lambda _sentence: None)


@pytest.mark.system
def test_the_command_ends_in_order_when_its_parent_does(bus_settings: BusSettings) -> None:
    environment = {
        **os.environ,
        "HANDEYE_BUS_ENDPOINT": bus_settings.endpoint,
        "HANDEYE_BUS_CELL": bus_settings.cell,
        "HANDEYE_SERVER_PORT": "0",
        "HANDEYE_SERVER_TOKEN": "not-to-be-shown",
    }
    command = [sys.executable, "-c", "from handeye.cli.main import main; main()", "server", "--watch-parent"]
    with (
        Bus.host(bus_settings, {}, name="router"),
        subprocess.Popen(
            command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as process,
    ):
        try:
            assert process.stderr is not None
            line = process.stderr.readline()
            assert line.startswith("The coordinator listens at http://127.0.0.1:")
            assert httpx2.get(f"{line.split()[-1]}/healthz", timeout=LIMIT).status_code == 200
            output, rest = process.communicate(timeout=LIMIT)  # closes its stdin
            assert process.returncode == 0, rest
            assert output == ""
            assert "not-to-be-shown" not in line + rest
        finally:
            process.kill()
