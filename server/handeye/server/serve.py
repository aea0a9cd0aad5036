"""The coordinator's process: joins the bus, listens, and ends in order."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

import uvicorn
from fastapi import FastAPI

from handeye.camera_bridge.remote import RemoteCameras, RemoteHead
from handeye.modules.module import warm_up
from handeye.robot_bridge.remote import RemoteRobot
from handeye.rpc import Bus, BusSettings
from handeye.server.access import Access, Tokens, show_first_token
from handeye.server.access.protocol import BoundedProtocol
from handeye.server.app import create_app
from handeye.server.control import Control
from handeye.server.coordinator import Coordinator
from handeye.server.eyes import Vision
from handeye.server.job import Job
from handeye.server.metrics import MeteredBus, Metrics
from handeye.server.settings import ServerSettings, StoreSettings
from handeye.server.store import Store
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
    tell: Callable[[str], None],
) -> None:
    """Serves until `stop` is set; then cancels the jobs, which stops the arm, and ends open requests.

    `tell` is given sentences for people: the address once it listens, and where the first token is. Raises
    `CannotListen`, `StoreError`, and the errors of `Bus.open`.
    """
    metrics = Metrics()
    settings.data_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
    with (
        closing(_listen(settings)) as listener,
        Store.open(StoreSettings().url(settings.data_dir)) as store,
        MeteredBus.joined(bus_settings, "coordinator", settings.connect_timeout, metrics) as bus,
        closing(Vision()) as vision,
    ):
        tokens = Tokens(store, settings.token)
        tokens.ensure_admin(lambda secret: show_first_token(secret, settings.data_dir, tell))
        coordinator = Coordinator(
            store,
            RemoteRobot(bus),
            Control(lambda holder: RemoteRobot(bus, holder), RemoteHead(bus)),
            RemoteCameras(bus),
            vision,
            settings,
            lambda: _missing(bus, starting),
            lambda job: count_job(metrics, job),
        )
        app = create_app(coordinator, Access(tokens, settings.limits, metrics))
        # At the end the jobs end first: an open event stream ends with its job.
        with (
            closing(WarmUp(_compile_kernels, coordinator.load)) as starting,
            http_server(app, listener, stop),
            closing(coordinator),
        ):
            tell(f"The coordinator listens at {_url(settings.host, listener)}")
            stop.wait()


def _compile_kernels(tell: Callable[[str], None]) -> None:
    tell("the learner's kernels are being compiled")
    warm_up()


def count_job(metrics: Metrics, job: Job) -> None:
    """Counts a job that has ended."""
    state = job.view().state
    metrics.jobs.labels(job.kind, state).inc()
    if job.kind == "motion":
        metrics.motions.labels(job.subject, state).inc()


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
        app,
        http=BoundedProtocol,
        log_config=None,
        access_log=False,
        server_header=False,
        lifespan="off",
        timeout_graceful_shutdown=_END_LIMIT,
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


def _missing(bus: Bus, starting: WarmUp) -> list[str]:
    """What the coordinator lacks, in sentences."""
    missing = [
        f"nobody serves {service} on the bus (do `handeye router` and `handeye {verb}` run?)"
        for service, verb in _SERVICES.items()
        if not bus.is_alive(service)
    ]
    return missing + ([starting.missing] if starting.missing else [])
