"""The coordinator's process: joins the bus, listens, and ends in order."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

import uvicorn
from fastapi import FastAPI
from pydantic import SecretStr

from handeye.camera_bridge.remote import RemoteCameras
from handeye.modules.module import warm_up as compile_kernels
from handeye.robot_bridge.remote import RemoteRobot
from handeye.rpc import Bus, BusSettings
from handeye.server.app import create_app
from handeye.server.auth import new_token
from handeye.server.coordinator import Coordinator
from handeye.server.eyes import Vision
from handeye.server.settings import ServerSettings
from handeye.server.warmup import WarmUp

_END_LIMIT = 2  # s that open requests get at the end
_JOIN_LIMIT = 4.0  # s until the HTTP server's thread is left behind
_SERVICES = {"Robot": "robot-bridge", "Camera": "camera-bridge"}  # and the verb that serves it


class CannotListen(OSError):
    """The address is taken, or none of this machine's."""


def serve(
    settings: ServerSettings,
    bus_settings: BusSettings,
    stop: threading.Event,
    announce: Callable[[str, SecretStr | None], None],
) -> None:
    """Serves until `stop` is set; then cancels the jobs, which stops the arm, and ends open requests.

    `announce` is called once it listens, with its address, and with the token if it had to make one. Raises
    `CannotListen`, and the errors of `Bus.open`.
    """
    token = settings.token or SecretStr(new_token())
    with (
        closing(_listen(settings)) as listener,
        Bus.open(bus_settings, name="coordinator", timeout=settings.connect_timeout) as bus,
        closing(WarmUp(compile_kernels)) as warm_up,
    ):
        coordinator = Coordinator(
            RemoteRobot(bus), RemoteCameras(bus), Vision(), settings, lambda: _missing(bus, warm_up)
        )
        app = create_app(coordinator, token.get_secret_value())
        # At the end the jobs end first: an open event stream ends with its job.
        with http_server(app, listener, stop), closing(coordinator):
            announce(_url(settings.host, listener), None if settings.token else token)
            stop.wait()


def _listen(settings: ServerSettings) -> socket.socket:
    """A socket at the settings' address; connections wait in it until the HTTP server takes them."""
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    try:
        return socket.create_server((settings.host, settings.port), family=family)
    except OSError as error:
        raise CannotListen(
            f"cannot listen at {settings.host}, port {settings.port} ({error.strerror}); choose another address by "
            "HANDEYE_SERVER_HOST and HANDEYE_SERVER_PORT (0: any free port)"
        ) from error


def _url(host: str, listener: socket.socket) -> str:
    return f"http://{f'[{host}]' if ':' in host else host}:{listener.getsockname()[1]}"


@contextmanager
def http_server(app: FastAPI, listener: socket.socket, stop: threading.Event) -> Iterator[None]:
    """Serves `app` in a thread; sets `stop` if the server ends by itself."""
    config = uvicorn.Config(
        app, log_config=None, access_log=False, lifespan="off", timeout_graceful_shutdown=_END_LIMIT
    )
    server = uvicorn.Server(config)

    def run() -> None:
        try:
            server.run(sockets=[listener])
        finally:
            stop.set()

    thread = threading.Thread(target=run, name="http", daemon=True)
    thread.start()
    try:
        yield
    finally:
        server.should_exit = True
        thread.join(_JOIN_LIMIT)


def _missing(bus: Bus, warm_up: WarmUp) -> list[str]:
    """What the coordinator lacks, in sentences."""
    missing = [
        f"nobody serves {service} on the bus (do `handeye router` and `handeye {verb}` run?)"
        for service, verb in _SERVICES.items()
        if not bus.is_alive(service)
    ]
    return missing + ([warm_up.missing] if warm_up.missing else [])
