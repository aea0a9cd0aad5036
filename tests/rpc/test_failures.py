"""What a caller sees when server, router or link fail: real processes, killed, frozen and cut off."""

from __future__ import annotations

import signal
import statistics
import subprocess
import threading
import time
from collections.abc import Callable
from typing import Protocol

import pytest

from handeye.proto.methods import (
    CAMERA_DESCRIBE,
    CAMERA_GRAB_STEREO,
    ROBOT_ADVANCE,
    ROBOT_GET_STATE,
    ROBOT_PARK,
    ROBOT_RESET,
    ROBOT_STOP,
)
from handeye.proto.v1 import camera_pb2, robot_pb2
from handeye.rpc import Bus, BusSettings, errors
from handeye.rpc.settings import LEASE

pytestmark = pytest.mark.system

AT_ONCE = 0.05
WITHIN_LEASE = LEASE + 0.5
Process = subprocess.Popen[bytes]
Start = Callable[..., Process]
Eventually = Callable[[Callable[[], bool]], bool]


class Link(Protocol):
    endpoint: str

    def cut(self) -> None: ...


def seconds_until_unavailable(bus: Bus, disaster: Callable[[], None]) -> float:
    """Seconds from the disaster, which comes while a call runs on the server, to the caller's Unavailable."""
    struck = []

    def strike(_progress: robot_pb2.MotionProgress) -> None:
        struck.append(time.monotonic())
        disaster()

    with pytest.raises(errors.Unavailable, match="died or was cut off"):
        bus.call(ROBOT_ADVANCE, robot_pb2.AdvanceRequest(duration=20.0), timeout=20.0, on_progress=strike)
    return time.monotonic() - struck[0]


def test_a_call_is_answered(steady: Bus) -> None:
    assert steady.call(ROBOT_GET_STATE, robot_pb2.GetStateRequest(), timeout=2.0).lease_holder == "caller"


def test_a_stereo_pair_passes(steady: Bus) -> None:
    pair = steady.call(CAMERA_GRAB_STEREO, camera_pb2.GrabStereoRequest(), timeout=5.0)
    assert len(pair.left.data) + len(pair.right.data) == 2 * 640 * 480 * 3


def test_absent_server_is_unavailable_at_once(steady: Bus) -> None:
    seconds = []
    for _ in range(5):
        begin = time.monotonic()
        with pytest.raises(errors.Unavailable, match="nobody serves it"):
            steady.call(CAMERA_DESCRIBE, camera_pb2.DescribeCameraRequest(), timeout=5.0)
        seconds.append(time.monotonic() - begin)
    assert statistics.median(seconds) < AT_ONCE


def test_server_killed_in_mid_call_is_unavailable_at_once(
    settings: BusSettings, caller: Bus, server: Process, start_server: Start, eventually: Eventually
) -> None:
    seconds = []
    for _ in range(3):
        seconds.append(seconds_until_unavailable(caller, server.kill))
        assert eventually(lambda: not caller.is_alive("Robot"))
        server = start_server(settings.endpoint)
        caller.wait_for("Robot", 20.0)
    assert statistics.median(seconds) < AT_ONCE


def test_frozen_server_is_unavailable_within_the_lease_and_serves_again(caller: Bus, server: Process) -> None:
    assert seconds_until_unavailable(caller, lambda: server.send_signal(signal.SIGSTOP)) < WITHIN_LEASE
    assert not caller.is_alive("Robot")
    server.send_signal(signal.SIGCONT)
    caller.wait_for("Robot", 10.0)
    caller.call(ROBOT_GET_STATE, robot_pb2.GetStateRequest(), timeout=5.0)


def test_call_to_a_frozen_server(caller: Bus, server: Process) -> None:
    server.send_signal(signal.SIGSTOP)
    begin = time.monotonic()
    with pytest.raises(errors.Unavailable):
        caller.call(ROBOT_GET_STATE, robot_pb2.GetStateRequest(), timeout=10.0)
    assert time.monotonic() - begin < WITHIN_LEASE


def test_router_killed_in_mid_call_is_unavailable_at_once(caller: Bus, router: Process) -> None:
    assert seconds_until_unavailable(caller, router.kill) < 5 * AT_ONCE


def test_router_frozen_in_mid_call_is_unavailable_within_the_lease(caller: Bus, router: Process) -> None:
    assert seconds_until_unavailable(caller, lambda: router.send_signal(signal.SIGSTOP)) < WITHIN_LEASE


def test_link_cut_in_mid_call_is_unavailable_within_the_lease(steady: Bus, link: Link) -> None:
    with Bus.open(BusSettings(endpoint=link.endpoint), "far") as far:
        assert seconds_until_unavailable(far, link.cut) < WITHIN_LEASE
    steady.call(ROBOT_GET_STATE, robot_pb2.GetStateRequest(), timeout=5.0)


def test_everybody_reconnects_to_a_restarted_router(
    settings: BusSettings, caller: Bus, router: Process, start_router: Start
) -> None:
    router.kill()
    router.wait()
    with pytest.raises(errors.Unavailable):
        caller.call(ROBOT_GET_STATE, robot_pb2.GetStateRequest(), timeout=5.0)
    time.sleep(4.0)  # longer than the time for which a bus tries to open
    start_router(settings.endpoint)
    caller.wait_for("Robot", 20.0)
    caller.call(ROBOT_GET_STATE, robot_pb2.GetStateRequest(), timeout=5.0)


def test_slow_server_ends_at_the_deadline(steady: Bus) -> None:
    begin = time.monotonic()
    with pytest.raises(errors.DeadlineExceeded, match=r"Robot\.Park did not answer within the time"):
        steady.call(ROBOT_PARK, robot_pb2.ParkRequest(), timeout=0.3)
    assert 0.3 <= time.monotonic() - begin < 0.3 + AT_ONCE


def test_silence_longer_than_zenoh_waits_by_default(steady: Bus) -> None:
    """Zenoh's own timeout is 10 s; the call's is what counts."""
    request = robot_pb2.AdvanceRequest(duration=11.0)
    assert steady.call(ROBOT_ADVANCE, request, timeout=20.0).world_time == 11.0


def test_raising_handler(steady: Bus) -> None:
    with pytest.raises(errors.Internal, match="ZeroDivisionError: by this much"):
        steady.call(ROBOT_STOP, robot_pb2.StopRequest(reason="by this much"), timeout=2.0)
    with pytest.raises(errors.OutOfLimits, match="joint 3 would leave its limits") as caught:
        steady.call(ROBOT_RESET, robot_pb2.ResetRequest(), timeout=2.0)
    assert caught.value.detail == "joint_3"


def test_server_that_is_told_to_end_leaves_no_call_unanswered(caller: Bus, server: Process) -> None:
    got: list[BaseException] = []
    under_way = threading.Event()

    def call() -> None:
        request = robot_pb2.AdvanceRequest(duration=20.0)
        try:
            caller.call(ROBOT_ADVANCE, request, timeout=20.0, on_progress=lambda _: under_way.set())
        except errors.RpcError as error:
            got.append(error)

    thread = threading.Thread(target=call)
    thread.start()
    assert under_way.wait(5.0)
    server.terminate()
    thread.join(10.0)
    assert [type(error) for error in got] == [errors.Unavailable]
    assert "closed during the call" in str(got[0])
    assert server.wait(10.0) == 0
