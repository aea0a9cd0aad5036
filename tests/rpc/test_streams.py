"""Streams and liveliness."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import pytest
import structlog

from handeye.proto.methods import CAMERA_STEREO, ROBOT_GET_STATE, ROBOT_HEARTBEAT, ROBOT_STATE
from handeye.proto.v1.camera_pb2 import Frame, StereoPair
from handeye.proto.v1.robot_pb2 import GetStateRequest, Heartbeat, RobotState
from handeye.rpc import Bus, BusSettings, errors

Eventually = Callable[[Callable[[], bool]], bool]


def test_newest_wins(client: Bus, server_bus: Bus, eventually: Eventually) -> None:
    with client.subscribe(ROBOT_STATE) as states:
        for number in range(100):
            server_bus.publish(ROBOT_STATE, RobotState(world_time=number))
        assert eventually(lambda: states.newest(0.1) == RobotState(world_time=99.0))
        assert states.newest(0.05) is None  # every message is returned once at most


def test_newest_waits_for_a_message(client: Bus, server_bus: Bus) -> None:
    with client.subscribe(ROBOT_STATE) as states:
        begin = time.monotonic()
        assert states.newest(0.2) is None
        assert 0.2 <= time.monotonic() - begin < 0.4
        timer = threading.Timer(0.1, server_bus.publish, (ROBOT_STATE, RobotState(world_time=5.0)))
        timer.start()
        assert states.newest(5.0) == RobotState(world_time=5.0)
        timer.join()


def test_callback(client: Bus, server_bus: Bus) -> None:
    got, arrived = [], threading.Event()

    def take(beat: Heartbeat) -> None:
        got.append(beat.lease_digest)
        arrived.set()

    with client.subscribe(ROBOT_HEARTBEAT, take):
        server_bus.publish(ROBOT_HEARTBEAT, Heartbeat(lease_digest="7"))
        assert arrived.wait(2.0)
    server_bus.publish(ROBOT_HEARTBEAT, Heartbeat(lease_digest="8"))
    assert got == ["7"]


def test_a_failing_callback_is_logged_and_called_again(client: Bus, server_bus: Bus, eventually: Eventually) -> None:
    got = []

    def fail(beat: Heartbeat) -> None:
        got.append(beat.lease_digest)
        raise ValueError(beat.lease_digest)

    with structlog.testing.capture_logs() as logs, client.subscribe(ROBOT_HEARTBEAT, fail):
        for number in range(2):
            server_bus.publish(ROBOT_HEARTBEAT, Heartbeat(lease_digest=str(number)))
            assert eventually(lambda number=number: len(got) > number)  # type: ignore[misc]
    assert [log["event"] for log in logs] == ["stream callback failed"] * 2


def test_a_slow_subscriber_delays_no_call(client: Bus, server_bus: Bus) -> None:
    blocked, go = threading.Event(), threading.Event()

    def block(_pair: StereoPair) -> None:
        blocked.set()
        go.wait(10.0)

    pair = StereoPair(left=Frame(data=bytes(921_600)), right=Frame(data=bytes(921_600)))
    with client.subscribe(CAMERA_STEREO, block), server_bus.serve({ROBOT_GET_STATE: lambda *_: RobotState()}):
        for _ in range(20):
            server_bus.publish(CAMERA_STEREO, pair)
        assert blocked.wait(5.0)
        begin = time.monotonic()
        client.call(ROBOT_GET_STATE, GetStateRequest(), timeout=5.0)
        assert time.monotonic() - begin < 1.0
        go.set()


def test_is_watched(client: Bus, server_bus: Bus, eventually: Eventually) -> None:
    assert not server_bus.is_watched(CAMERA_STEREO)
    with client.subscribe(CAMERA_STEREO):
        assert eventually(lambda: server_bus.is_watched(CAMERA_STEREO))
    assert eventually(lambda: not server_bus.is_watched(CAMERA_STEREO))


def test_liveliness(client: Bus, server_bus: Bus, eventually: Eventually) -> None:
    assert not client.is_alive("Robot")
    with server_bus.serve({ROBOT_GET_STATE: lambda *_: RobotState()}):
        assert client.is_alive("Robot")
        assert not client.is_alive("Camera")
    assert eventually(lambda: not client.is_alive("Robot"))
    with pytest.raises(errors.Unavailable, match=r"nobody served Robot within 0\.1 s"):
        client.wait_for("Robot", 0.1)


def test_cells_are_apart(client: Bus, settings: BusSettings, server_bus: Bus) -> None:
    other = settings.model_copy(update={"cell": "other"})
    with server_bus.serve({ROBOT_GET_STATE: lambda *_: RobotState()}), Bus.open(other, "other") as bus:
        assert not bus.is_alive("Robot")
        with pytest.raises(errors.Unavailable):
            bus.call(ROBOT_GET_STATE, GetStateRequest(), timeout=2.0)


def test_closing_the_bus_closes_what_it_opened(settings: BusSettings, host: Bus) -> None:
    bus = Bus.open(settings, "leaving")
    subscription = bus.subscribe(ROBOT_STATE, lambda _: None)
    bus.serve({ROBOT_GET_STATE: lambda *_: RobotState()})
    bus.close()
    bus.close()
    subscription.close()
    with pytest.raises(errors.Unavailable, match="bus is closed"):
        bus.publish(ROBOT_STATE, RobotState())
    with pytest.raises(errors.Unavailable, match="bus is closed"):
        bus.is_watched(ROBOT_STATE)
