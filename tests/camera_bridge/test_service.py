"""The camera service on a real bus, with fake cameras."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest

from handeye.camera_bridge.remote import RemoteCameras, RemoteHead
from handeye.camera_bridge.service import CameraService
from handeye.proto.methods import CAMERA_GRAB_OBSERVER, CAMERA_GRAB_STEREO, CAMERA_STEREO, ROBOT_HEARTBEAT
from handeye.proto.v1 import camera_pb2, robot_pb2
from handeye.robot_bridge.lease import lease_digest
from handeye.rpc import Bus
from handeye.rpc.errors import DeadlineExceeded, InvalidArgument, Unavailable
from tests.camera_bridge.fake_cameras import FakeCameras, FakeClock, FakeHead

Join = Callable[[str], Bus]


@dataclass(frozen=True)
class Served:
    clock: FakeClock
    cameras: FakeCameras
    head: FakeHead


@pytest.fixture
def served(join: Join) -> Iterator[Served]:
    clock = FakeClock()
    head = FakeHead(clock)
    cameras = FakeCameras(clock, head)
    with CameraService(cameras, head, join("camera-bridge"), stream_rate=50.0):
        yield Served(clock, cameras, head)


def test_the_description_is_that_of_the_drivers(served: Served, join: Join) -> None:
    bus = join("client")
    cameras, head = RemoteCameras(bus), RemoteHead(bus)
    assert cameras.size == served.cameras.size
    assert cameras.latency == served.cameras.latency
    assert head.limits == served.head.limits
    assert (head.step, head.speed) == (served.head.step, served.head.speed)


def test_a_grab_waits_for_the_world(served: Served, join: Join) -> None:
    cameras = RemoteCameras(join("client"))
    wanted = served.clock() + 0.5
    later = threading.Timer(0.1, served.clock.advance, (1.0,))
    later.start()
    pair = cameras.grab_stereo(wanted, 5.0)
    later.join()
    assert pair.left.world_time >= wanted


def test_the_reason_for_no_picture_arrives_before_the_deadline(served: Served, join: Join) -> None:
    cameras = RemoteCameras(join("client"))
    started = time.monotonic()
    with pytest.raises(DeadlineExceeded, match=r"the newest shows 9\.9"):
        cameras.grab_stereo(99.0, 0.6)
    assert time.monotonic() - started < 0.6


@pytest.mark.parametrize("wanted", [math.nan, math.inf, -math.inf])
def test_a_time_that_is_no_number_is_refused(served: Served, join: Join, wanted: float) -> None:
    bus = join("client")
    with pytest.raises(InvalidArgument, match="not_older_than"):
        bus.call(CAMERA_GRAB_STEREO, camera_pb2.GrabStereoRequest(not_older_than=wanted), timeout=5.0)
    with pytest.raises(InvalidArgument, match="not_older_than"):
        bus.call(CAMERA_GRAB_OBSERVER, camera_pb2.GrabObserverRequest(not_older_than=wanted), timeout=5.0)


def test_the_stream_survives_a_camera_that_fails(served: Served, join: Join, monkeypatch: pytest.MonkeyPatch) -> None:
    failed = threading.Event()

    def fail(*_: object) -> None:
        failed.set()
        raise ZeroDivisionError

    with join("watcher").subscribe(CAMERA_STEREO) as stream:
        with monkeypatch.context() as broken:
            broken.setattr(served.cameras, "grab_stereo", fail)
            assert failed.wait(5.0)
        while stream.newest(0.0) is not None:
            pass
        served.clock.advance(0.1)
        assert stream.newest(5.0) is not None


def test_nobody_watching_means_no_pictures(served: Served, join: Join) -> None:
    before = served.cameras.grab_stereo(0.0, 1.0).left.sequence
    for _ in range(10):  # of the stream's periods
        served.clock.advance(0.1)
        time.sleep(0.02)
    assert served.cameras.grab_stereo(0.0, 1.0).left.sequence == before + 1


def test_the_stream_shows_each_new_pair_once(served: Served, join: Join) -> None:
    with join("watcher").subscribe(CAMERA_STEREO) as stream:
        first = stream.newest(5.0)
        assert first is not None  # at once, though the world stands still
        assert stream.newest(0.2) is None
        served.clock.advance(0.1)
        second = stream.newest(5.0)
        assert second is not None
        assert second.left.sequence == first.left.sequence + 1
        assert second.left.world_time > first.left.world_time


def test_a_head_move_keeps_the_lease_alive(served: Served, join: Join) -> None:
    beats: list[str] = []
    beaten = threading.Event()

    def on_beat(message: robot_pb2.Heartbeat) -> None:
        beats.append(message.lease_digest)
        beaten.set()

    with join("robot-bridge").subscribe(ROBOT_HEARTBEAT, on_beat):
        bus = join("client")
        deadline = time.monotonic() + 5.0
        while not beaten.is_set() and time.monotonic() < deadline:
            RemoteHead(bus).move(0.1, 0.0, "the lease", 5.0)
            RemoteHead(bus).move(0.0, 0.0, "the lease", 5.0)
    assert set(beats) == {lease_digest("the lease")}


def test_after_closing_nobody_answers(join: Join) -> None:
    clock = FakeClock()
    head = FakeHead(clock)
    bus = join("client")
    with CameraService(FakeCameras(clock, head), head, join("camera-bridge")):
        assert RemoteHead(bus).state().world_time == clock()
    with pytest.raises(Unavailable):
        RemoteHead(bus).state()
