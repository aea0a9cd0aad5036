"""Router and camera bridge in a process of their own (`python -m benchmarks.step.cameras`), with pictures of before."""

from __future__ import annotations

import argparse
import itertools
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.step.scenes import HOME, read
from handeye.camera_bridge.driver import Course, Frame, HeadState, StereoPair, Tick
from handeye.camera_bridge.service import CameraService
from handeye.cli.up import LOOPBACK, free_ports
from handeye.rpc import Bus, BusSettings
from handeye.rpc.errors import InvalidArgument

_WAIT = 30.0  # s for the process to serve, and to end


class Album:
    """A `CameraDriver` that shows its pictures one after the other, again and again."""

    latency = 0.0

    def __init__(self, pairs: list[StereoPair]) -> None:
        self._pages = itertools.cycle(pairs)
        self.size = (pairs[0].left.image.shape[0], pairs[0].left.image.shape[1])

    def grab_stereo(self, not_older_than: float, timeout: float, on_tick: Tick | None = None) -> StereoPair:
        """The next pair."""
        return next(self._pages)

    def grab_observer(self, not_older_than: float, timeout: float) -> Frame:
        """There is no such camera."""
        raise InvalidArgument("nobody observes")

    def close(self) -> None:
        """Nothing to release."""


class StillHead:
    """A `HeadDriver` that stays where it is."""

    limits = ((-3.0, 3.0), (-1.5, 0.5))
    step = 0.0
    speed = 1.0

    def state(self) -> HeadState:
        """At home."""
        return HeadState(*HOME, False, 0.0)

    def move(self, pan: float, tilt: float, lease_id: str, timeout: float, on_tick: Tick | None = None) -> HeadState:
        """Does not turn."""
        return self.state()

    def follow(self, course: Course, lasting: float, lease_id: str, timeout: float) -> HeadState:
        """Does not turn."""
        return self.state()

    def close(self) -> None:
        """Nothing to release."""


@contextmanager
def serving(pictures: Path) -> Iterator[Bus]:
    """A bus on which another process serves the pictures of an .npz."""
    (port,) = free_ports(1)
    settings = BusSettings(endpoint=f"tcp/{LOOPBACK}:{port}")
    command = [sys.executable, "-m", "benchmarks.step.cameras", str(pictures)]
    process = subprocess.Popen(
        command, env=os.environ | {"HANDEYE_BUS_ENDPOINT": settings.endpoint}, stdin=subprocess.PIPE
    )
    try:
        with Bus.open(settings, name="benchmark", timeout=_WAIT) as bus:
            bus.wait_for("Camera", _WAIT)
            yield bus
    finally:
        assert process.stdin is not None
        process.stdin.close()
        process.wait(_WAIT)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pictures", type=Path)
    album = Album(read(parser.parse_args().pictures))
    settings = BusSettings()
    with (
        Bus.host(settings, {}, name="router"),
        Bus.open(settings, name="camera-bridge") as bus,
        CameraService(album, StillHead(), bus),
    ):
        sys.stdin.read()  # until the benchmark closes it


if __name__ == "__main__":
    main()
