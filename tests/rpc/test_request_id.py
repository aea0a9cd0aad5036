"""The id of the HTTP request that a call is made for is in the log lines of the handler's process too."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import structlog
from structlog.contextvars import bound_contextvars, get_contextvars, merge_contextvars

from handeye.proto.methods import ROBOT_GET_STATE, ROBOT_STOP
from handeye.proto.v1.robot_pb2 import GetStateRequest, RobotState, StopRequest
from handeye.rpc import Bus, Call
from handeye.rpc.errors import Internal

log = structlog.get_logger()
Lines = list[dict[str, object]]


@pytest.fixture
def lines() -> Iterator[Lines]:
    captured = structlog.testing.LogCapture()
    before = structlog.get_config()["processors"]
    structlog.configure(processors=[merge_contextvars, captured])
    yield captured.entries  # type: ignore[misc]
    structlog.configure(processors=before)


def read(_request: GetStateRequest, call: Call) -> RobotState:
    log.info("read", caller=call.caller)
    return RobotState()


def fail(_request: StopRequest, _call: Call) -> RobotState:
    raise ZeroDivisionError


def test_the_handler_s_lines_have_the_caller_s_request_id(client: Bus, server_bus: Bus, lines: Lines) -> None:
    with server_bus.serve({ROBOT_GET_STATE: read, ROBOT_STOP: fail}):
        with bound_contextvars(request_id="abc-1"):
            client.call(ROBOT_GET_STATE, GetStateRequest(), 5.0)
            with pytest.raises(Internal):
                client.call(ROBOT_STOP, StopRequest(), 5.0)
        with bound_contextvars(request_id="abc-2"):
            client.call(ROBOT_GET_STATE, GetStateRequest(), 5.0)
    assert [(line["event"], line["request_id"]) for line in lines] == [
        ("read", "abc-1"),
        ("handler failed", "abc-1"),
        ("read", "abc-2"),
    ]


def test_a_call_for_no_request_has_none_also_after_others(client: Bus, server_bus: Bus, lines: Lines) -> None:
    with server_bus.serve({ROBOT_GET_STATE: read}):
        for _ in range(5):
            with bound_contextvars(request_id="abc"):
                client.call(ROBOT_GET_STATE, GetStateRequest(), 5.0)
            client.call(ROBOT_GET_STATE, GetStateRequest(), 5.0)
    assert [line.get("request_id") for line in lines] == ["abc", None] * 5
    assert get_contextvars() == {}


def test_an_error_of_the_handler_s_thread_leaves_no_id(client: Bus, server_bus: Bus, lines: Lines) -> None:
    with server_bus.serve({ROBOT_GET_STATE: read, ROBOT_STOP: fail}):
        with bound_contextvars(request_id="abc"), pytest.raises(Internal):
            client.call(ROBOT_STOP, StopRequest(), 5.0)
        client.call(ROBOT_GET_STATE, GetStateRequest(), 5.0)
    assert "request_id" not in lines[-1]
