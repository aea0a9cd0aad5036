"""What is counted, and the bus that counts its calls."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from typing import Any

import pytest
from prometheus_client.exposition import generate_latest
from prometheus_client.parser import text_string_to_metric_families

from handeye.proto.methods import ROBOT_ADVANCE, ROBOT_GET_STATE, ROBOT_PARK, ROBOT_STOP
from handeye.proto.v1.robot_pb2 import (
    AdvanceRequest,
    GetStateRequest,
    MotionProgress,
    ParkRequest,
    RobotState,
    StopRequest,
)
from handeye.rpc import Bus, BusSettings, Call, Handler, Method
from handeye.rpc.errors import Busy, DeadlineExceeded, Unavailable
from handeye.server.metrics import MeteredBus, Metrics


def sample(metrics: Metrics, name: str, **labels: str) -> float:
    return metrics.registry.get_sample_value(name, labels) or 0.0


def test_two_applications_count_apart() -> None:
    one, other = Metrics(), Metrics()
    one.queries.labels("ijs").inc(3)
    assert sample(one, "handeye_queries_total", module="ijs") == 3
    assert sample(other, "handeye_queries_total", module="ijs") == 0


def test_prometheus_reads_it() -> None:
    metrics = Metrics()
    metrics.request("GET", "/v1/modules/{m}", 200, 0.003)
    metrics.rpc("Robot.GetState", "ok", 0.0002)
    metrics.queries.labels('a "quoted" module').inc(10)
    metrics.samples.labels("ijs").inc(1000)
    metrics.frames.labels("left").inc()
    metrics.motions.labels("park", "ok").inc()
    metrics.jobs.labels("run", "succeeded").inc()
    families = {family.name for family in text_string_to_metric_families(generate_latest(metrics.registry).decode())}
    assert {
        "handeye_requests",
        "handeye_request_seconds",
        "handeye_rpc_seconds",
        "handeye_queries",
        "handeye_samples_written",
        "handeye_frames",
        "handeye_motions",
        "handeye_jobs",
        "process_resident_memory_bytes",
    } <= families
    assert not any(name.endswith("_created") for name in families)


def test_a_deleted_module_has_no_series() -> None:
    metrics = Metrics()
    metrics.queries.labels("ijs").inc()
    metrics.queries.labels("other").inc()
    metrics.samples.labels("ijs").inc()
    metrics.forget_module("ijs")
    metrics.forget_module("unknown")
    text = generate_latest(metrics.registry).decode()
    assert 'module="ijs"' not in text
    assert 'module="other"' in text


def test_methods_and_series_of_requests_are_few() -> None:
    metrics = Metrics()
    for number in range(100):
        metrics.request(f"BREW{number}", "none", 405, 0.001)
    assert sample(metrics, "handeye_requests_total", method="other", route="none", status="405") == 100


@pytest.fixture
def settings() -> BusSettings:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return BusSettings(endpoint=f"tcp/127.0.0.1:{probe.getsockname()[1]}")


@pytest.fixture
def host(settings: BusSettings) -> Iterator[Bus]:
    with Bus.host(settings, {}) as bus:
        yield bus


def advance(_request: AdvanceRequest, call: Call) -> RobotState:
    call.progress(MotionProgress(fraction=0.5))
    while True:
        call.check()


def stop(_request: StopRequest, _call: Call) -> RobotState:
    raise Busy("a motion is under way")


def test_calls_are_counted_by_method_and_outcome(settings: BusSettings, host: Bus) -> None:
    metrics = Metrics()

    def leave(_progress: object) -> None:
        raise ZeroDivisionError

    served: dict[Method[Any, Any], Handler] = {
        ROBOT_GET_STATE: lambda _request, _call: RobotState(),
        ROBOT_STOP: stop,
        ROBOT_ADVANCE: advance,
    }
    with host.serve(served), MeteredBus.joined(settings, "coordinator", 5.0, metrics) as bus:
        for _ in range(3):
            bus.call(ROBOT_GET_STATE, GetStateRequest(), 5.0)
        with pytest.raises(Busy):
            bus.call(ROBOT_STOP, StopRequest(), 5.0)
        with pytest.raises(Unavailable):
            bus.call(ROBOT_PARK, ParkRequest(), 5.0)
        with pytest.raises(ZeroDivisionError):
            bus.call(ROBOT_ADVANCE, AdvanceRequest(), 5.0, on_progress=leave)
        with pytest.raises(DeadlineExceeded):
            bus.call(ROBOT_ADVANCE, AdvanceRequest(), 0.1)

    def count(method: str, outcome: str) -> float:
        return sample(metrics, "handeye_rpc_seconds_count", method=method, outcome=outcome)

    assert count("Robot.GetState", "ok") == 3
    assert count("Robot.Stop", "busy") == 1
    assert count("Robot.Park", "unavailable") == 1
    assert count("Robot.Advance", "left") == 1
    assert count("Robot.Advance", "deadline_exceeded") == 1
    assert 0 < sample(metrics, "handeye_rpc_seconds_sum", method="Robot.GetState", outcome="ok") < 5
