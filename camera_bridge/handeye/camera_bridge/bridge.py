"""The camera bridge as a process: opens the cameras that the settings name and serves them until it is told to stop."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import structlog

from handeye.camera_bridge.driver import CameraDriver, HeadDriver
from handeye.camera_bridge.service import CameraService
from handeye.camera_bridge.settings import CameraBridgeSettings
from handeye.rpc import Bus, BusSettings, LabBusSettings

_log = structlog.get_logger()

ROUTER_TIMEOUT = 10.0
"""Seconds to wait for the router: processes that start together are not ready together."""


class MissingExtra(Exception):
    """A driver needs a package that is not installed; the message names the extra to install."""


def run(settings: CameraBridgeSettings, stop: threading.Event) -> None:
    """Serves cameras and head until `stop` is set. Raises `MissingExtra`, and what `Bus.open` raises."""
    with (
        Bus.open(BusSettings(), name="camera-bridge", timeout=ROUTER_TIMEOUT) as bus,
        open_cameras(settings, bus, stop) as (cameras, head),
        CameraService(cameras, head, bus, stream_rate=settings.stream_rate),
    ):
        _log.info("camera bridge serves", **settings.model_dump())
        stop.wait()


@contextmanager
def open_cameras(
    settings: CameraBridgeSettings, bus: Bus, stop: threading.Event
) -> Iterator[tuple[CameraDriver, HeadDriver]]:
    """The drivers that the settings name, closed at the end; the simulated ones look at the world over the lab bus.

    Setting `stop` ends the wait for the lab bus.
    """
    # Only here and only now: a bridge with a hardware driver needs no simulator.
    try:
        from handeye.camera_bridge.drivers.simulated import connect
    except ModuleNotFoundError as error:
        raise MissingExtra(
            f"the simulated cameras need {error.name!r}, which is not installed: pip install 'handeye[camera]', "
            "on CPython 3.11 (the simulator's wheels exist for no later one)"
        ) from error
    with connect(LabBusSettings(), bus, settings.lab_timeout, stop) as drivers:
        yield drivers
