"""Calls, long calls, cancellation and idempotency, on a bus within this process."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import pytest
import structlog
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from handeye.proto.methods import (
    CAMERA_GRAB_STEREO,
    ROBOT_ADVANCE,
    ROBOT_GET_STATE,
    ROBOT_PARK,
    ROBOT_STOP,
)
from handeye.proto.v1 import camera_pb2, robot_pb2
from handeye.proto.v1.robot_pb2 import AdvanceRequest, GetStateRequest, MotionProgress, ParkRequest, RobotState
from handeye.proto.v1.rpc_pb2 import (
    ERROR_CODE_DEADLINE_EXCEEDED,
    ERROR_CODE_INVALID_ARGUMENT,
    CallReply,
    CallRequest,
)
from handeye.rpc import Bus, BusSettings, Call, errors
from handeye.rpc.method import key

Eventually = Callable[[Callable[[], bool]], bool]


def get_state(_request: GetStateRequest, call: Call) -> RobotState:
    return RobotState(world_time=3.0, lease_holder=call.caller)


class UntilCancelled:
    """A handler that runs until its call is over and remembers why it ended."""

    def __init__(self) -> None:
        self.begun = threading.Event()
        self.ended = threading.Event()
        self.why: errors.RpcError | None = None
        self.calls = 0

    def __call__(self, _request: AdvanceRequest, call: Call) -> RobotState:
        self.calls += 1
        self.begun.set()
        try:
            while True:
                call.check()
                time.sleep(0.002)
        except errors.RpcError as error:
            self.why = error
            raise
        finally:
            self.ended.set()


def test_response_and_caller(client: Bus, server_bus: Bus) -> None:
    with server_bus.serve({ROBOT_GET_STATE: get_state}):
        assert client.call(ROBOT_GET_STATE, GetStateRequest(), timeout=2.0) == RobotState(
            world_time=3.0, lease_holder="client"
        )


def test_host_serves_and_calls(client: Bus, host: Bus) -> None:
    with host.serve({ROBOT_GET_STATE: get_state}):
        assert client.call(ROBOT_GET_STATE, GetStateRequest(), timeout=2.0).lease_holder == "client"
        assert host.call(ROBOT_GET_STATE, GetStateRequest(), timeout=2.0).lease_holder == "host"


def test_methods_are_served_while_the_server_is_open(client: Bus, server_bus: Bus, eventually: Eventually) -> None:
    for _ in range(10):
        with server_bus.serve({ROBOT_GET_STATE: get_state}) as server:
            client.call(ROBOT_GET_STATE, GetStateRequest(), timeout=2.0)
            assert client.is_alive("Robot")
        assert eventually(lambda: not client.is_alive("Robot"))
        with pytest.raises(errors.Unavailable):
            client.call(ROBOT_GET_STATE, GetStateRequest(), timeout=2.0)
        server.close()  # again


def test_empty_response_is_a_response(client: Bus, server_bus: Bus) -> None:
    with server_bus.serve({ROBOT_GET_STATE: lambda *_: RobotState()}):
        assert client.call(ROBOT_GET_STATE, GetStateRequest(), timeout=2.0) == RobotState()


def test_large_request_and_response(client: Bus, server_bus: Bus) -> None:
    def echo(request: robot_pb2.StopRequest, _call: Call) -> RobotState:
        return RobotState(lease_holder=request.reason)

    with server_bus.serve({ROBOT_STOP: echo}):
        reason = "x" * 1_800_000
        assert client.call(ROBOT_STOP, robot_pb2.StopRequest(reason=reason), timeout=5.0).lease_holder == reason


@hypothesis_settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(joints=st.lists(st.floats(allow_nan=False), max_size=8), data=st.binary(max_size=300))
def test_messages_arrive_as_they_were_sent(client: Bus, server_bus: Bus, joints: list[float], data: bytes) -> None:
    pair = camera_pb2.StereoPair(left=camera_pb2.Frame(data=data), skew=sum(joints[:1]))
    with server_bus.serve({CAMERA_GRAB_STEREO: lambda *_: pair}):
        assert client.call(CAMERA_GRAB_STEREO, camera_pb2.GrabStereoRequest(), timeout=5.0) == pair


@pytest.mark.parametrize(
    "error",
    [cls("so it is", detail="d") for cls in errors.RpcError.__subclasses__() if cls.__module__ == errors.__name__],
    ids=lambda error: type(error).__name__,
)
def test_typed_errors_arrive_as_they_were_raised(client: Bus, server_bus: Bus, error: errors.RpcError) -> None:
    def fail(*_: object) -> RobotState:
        raise error

    with server_bus.serve({ROBOT_GET_STATE: fail}), pytest.raises(errors.RpcError) as caught:
        client.call(ROBOT_GET_STATE, GetStateRequest(), timeout=2.0)
    assert (type(caught.value), str(caught.value), caught.value.detail) == (type(error), "so it is", "d")


@pytest.mark.parametrize("raised", [ValueError("no such thing"), SystemExit("no such thing")])
def test_other_exceptions_are_internal_and_logged(client: Bus, server_bus: Bus, raised: BaseException) -> None:
    def fail(*_: object) -> RobotState:
        raise raised

    internal = pytest.raises(errors.Internal, match=f"{type(raised).__name__}: no such thing")
    with structlog.testing.capture_logs() as logs, server_bus.serve({ROBOT_GET_STATE: fail}), internal:
        client.call(ROBOT_GET_STATE, GetStateRequest(), timeout=2.0)
    assert [(log["event"], log["exc_info"]) for log in logs] == [("handler failed", True)]


def test_wrong_response_type_is_internal(client: Bus, server_bus: Bus) -> None:
    internal = pytest.raises(errors.Internal, match=r"Robot\.GetState returned MotionProgress")
    with server_bus.serve({ROBOT_GET_STATE: lambda *_: MotionProgress()}), internal:
        client.call(ROBOT_GET_STATE, GetStateRequest(), timeout=2.0)


def test_what_is_no_call_is_refused(client: Bus, server_bus: Bus) -> None:
    with server_bus.serve({ROBOT_GET_STATE: get_state}):
        malformed = CallRequest(call_id="1", time_left=1.0, payload=b"\xff").SerializeToString()
        for payload in (b"\xff\xff", malformed, None):
            [reply] = client._session.get("handeye/cell/robot/get_state", payload=payload, timeout=2.0)
            assert reply.ok is not None
            answer = CallReply.FromString(reply.ok.payload.to_bytes())
            assert answer.error.code in (ERROR_CODE_INVALID_ARGUMENT, ERROR_CODE_DEADLINE_EXCEEDED)


def test_slow_call_does_not_block_a_fast_one(client: Bus, server_bus: Bus) -> None:
    slow = UntilCancelled()
    with server_bus.serve({ROBOT_ADVANCE: slow, ROBOT_GET_STATE: get_state}), ThreadPoolExecutor(4) as pool:
        waiting = [pool.submit(client.call, ROBOT_ADVANCE, AdvanceRequest(), 1.0) for _ in range(4)]
        assert slow.begun.wait(2.0)
        begin = time.monotonic()
        for _ in range(20):
            client.call(ROBOT_GET_STATE, GetStateRequest(), timeout=2.0)
        assert time.monotonic() - begin < 0.5
        assert all(isinstance(call.exception(), errors.DeadlineExceeded) for call in waiting)


def test_progress_arrives_complete_and_in_order(client: Bus, server_bus: Bus) -> None:
    def move(_request: ParkRequest, call: Call) -> RobotState:
        for step in range(200):
            call.progress(MotionProgress(fraction=step / 200))
        return RobotState(world_time=1.0)

    seen: list[float] = []
    with server_bus.serve({ROBOT_PARK: move}):
        state = client.call(ROBOT_PARK, ParkRequest(), 5.0, on_progress=lambda p: seen.append(p.fraction))
        assert client.call(ROBOT_PARK, ParkRequest(), timeout=5.0) == state  # nobody needs to look
    assert seen == [step / 200 for step in range(200)]


def test_progress_of_the_wrong_type_is_a_bug(client: Bus, server_bus: Bus) -> None:
    def move(_request: ParkRequest, call: Call) -> RobotState:
        call.progress(RobotState())
        return RobotState()

    with server_bus.serve({ROBOT_PARK: move}), pytest.raises(errors.Internal, match="TypeError"):
        client.call(ROBOT_PARK, ParkRequest(), timeout=2.0)


def test_ticks_come_every_20_ms(client: Bus, server_bus: Bus) -> None:
    def rest(_request: ParkRequest, call: Call) -> RobotState:
        end = time.monotonic() + 0.5
        while time.monotonic() < end:  # progress does not keep the ticks from coming
            call.progress(MotionProgress())
            time.sleep(0.001)
        return RobotState()

    ticks: list[float] = []
    with server_bus.serve({ROBOT_PARK: rest}):
        client.call(ROBOT_PARK, ParkRequest(), 5.0, on_tick=lambda: ticks.append(time.monotonic()))
    assert 15 <= len(ticks) <= 27
    assert max(b - a for a, b in pairwise(ticks)) < 0.1


@pytest.mark.parametrize("leave_by", ["on_tick", "on_progress"])
def test_leaving_a_call_cancels_it(client: Bus, server_bus: Bus, leave_by: str) -> None:
    handler = UntilCancelled()

    def advance(request: AdvanceRequest, call: Call) -> RobotState:
        call.progress(MotionProgress())
        return handler(request, call)

    def leave(*_: object) -> None:
        if handler.begun.is_set() or leave_by == "on_progress":
            raise KeyboardInterrupt

    with server_bus.serve({ROBOT_ADVANCE: advance}):
        with pytest.raises(KeyboardInterrupt):
            client.call(ROBOT_ADVANCE, AdvanceRequest(), 5.0, **{leave_by: leave})  # type: ignore[arg-type]
        assert handler.ended.wait(2.0)
    assert isinstance(handler.why, errors.Cancelled)
    assert "cancelled by client" in str(handler.why)


def test_cancel_that_follows_at_once_is_not_lost(client: Bus, server_bus: Bus, eventually: Eventually) -> None:
    """Call and cancellation stay in order: the handler is cancelled, or never runs."""
    handler = UntilCancelled()

    def leave() -> None:
        raise KeyboardInterrupt

    with server_bus.serve({ROBOT_ADVANCE: handler}) as server:
        for _ in range(50):
            with pytest.raises(KeyboardInterrupt):
                client.call(ROBOT_ADVANCE, AdvanceRequest(), timeout=60.0, on_tick=leave)
        assert eventually(lambda: not server._under_way)


def test_the_deadline_ends_the_handler_too(client: Bus, server_bus: Bus) -> None:
    handler = UntilCancelled()
    with server_bus.serve({ROBOT_ADVANCE: handler}):
        with pytest.raises(errors.DeadlineExceeded):
            client.call(ROBOT_ADVANCE, AdvanceRequest(), timeout=0.1)
        assert handler.ended.wait(1.0)
    assert isinstance(handler.why, errors.DeadlineExceeded | errors.Cancelled)


def test_time_left_is_what_the_caller_still_waits(client: Bus, server_bus: Bus) -> None:
    left: list[float] = []

    def look(_request: GetStateRequest, call: Call) -> RobotState:
        left.append(call.time_left())
        return RobotState()

    with server_bus.serve({ROBOT_GET_STATE: look}):
        client.call(ROBOT_GET_STATE, GetStateRequest(), timeout=3.0)
        with pytest.raises(errors.DeadlineExceeded):
            client.call(ROBOT_GET_STATE, GetStateRequest(), timeout=-1.0)
    assert len(left) == 1
    assert 2.5 < left[0] <= 3.0


def test_closing_the_server_ends_its_calls(client: Bus, server_bus: Bus) -> None:
    handler = UntilCancelled()
    with ThreadPoolExecutor(1) as pool:
        with server_bus.serve({ROBOT_ADVANCE: handler}):
            call = pool.submit(client.call, ROBOT_ADVANCE, AdvanceRequest(), 20.0)
            assert handler.begun.wait(2.0)
        with pytest.raises(errors.Unavailable, match="closed during the call"):
            call.result(2.0)


def test_closing_the_bus_ends_the_calls_of_its_other_threads(settings: BusSettings, host: Bus, server_bus: Bus) -> None:
    handler = UntilCancelled()
    with server_bus.serve({ROBOT_ADVANCE: handler}), ThreadPoolExecutor(1) as pool:
        with Bus.open(settings, "leaving") as bus:
            call = pool.submit(bus.call, ROBOT_ADVANCE, AdvanceRequest(), 20.0)
            assert handler.begun.wait(2.0)
        with pytest.raises(errors.Unavailable):
            call.result(2.0)
        with pytest.raises(errors.Unavailable, match="bus is closed"):
            bus.call(ROBOT_GET_STATE, GetStateRequest(), timeout=1.0)
        assert not bus.is_alive("Robot")


class TestIdempotency:
    """Calls with one idempotency id are executed once."""

    def test_repeated_call_gets_the_first_answer(self, client: Bus, server_bus: Bus) -> None:
        calls: list[int] = []

        def count(*_: object) -> RobotState:
            calls.append(1)
            return RobotState(world_time=len(calls))

        with server_bus.serve({ROBOT_GET_STATE: count}):
            ids = ["a", "a", "b", "", "", "a"]
            got = [client.call(ROBOT_GET_STATE, GetStateRequest(), 2.0, idempotency_id=i).world_time for i in ids]
        assert got == [1, 1, 2, 3, 4, 1]

    def test_an_error_is_remembered_too(self, client: Bus, server_bus: Bus) -> None:
        calls: list[int] = []

        def refuse(*_: object) -> RobotState:
            calls.append(1)
            raise errors.Busy(f"refused {len(calls)} times")

        with server_bus.serve({ROBOT_GET_STATE: refuse}):
            for _ in range(3):
                with pytest.raises(errors.Busy, match="refused 1 times"):
                    client.call(ROBOT_GET_STATE, GetStateRequest(), 2.0, idempotency_id="a")

    def test_second_call_joins_the_first(self, client: Bus, server_bus: Bus) -> None:
        begun, go = threading.Event(), threading.Event()
        calls: list[int] = []

        def wait(_request: ParkRequest, call: Call) -> RobotState:
            calls.append(1)
            begun.set()
            assert go.wait(5.0)
            call.progress(MotionProgress(fraction=0.5))
            return RobotState(world_time=9.0)

        seen: list[float] = []
        with server_bus.serve({ROBOT_PARK: wait}) as server, ThreadPoolExecutor(2) as pool:
            first = pool.submit(client.call, ROBOT_PARK, ParkRequest(), 5.0, idempotency_id="a")
            assert begun.wait(2.0)
            second = pool.submit(
                client.call, ROBOT_PARK, ParkRequest(), 5.0, lambda p: seen.append(p.fraction), idempotency_id="a"
            )
            deadline = time.monotonic() + 2.0
            while len(server._under_way) < 2 and time.monotonic() < deadline:
                time.sleep(0.005)
            go.set()
            assert first.result().world_time == second.result().world_time == 9.0
        assert (calls, seen) == ([1], [0.5])

    def test_a_call_whose_callers_left_is_executed_again(self, client: Bus, server_bus: Bus) -> None:
        calls: list[int] = []

        def wait_once(_request: AdvanceRequest, call: Call) -> RobotState:
            calls.append(1)
            while len(calls) == 1:
                call.check()
                time.sleep(0.005)
            return RobotState(world_time=2.0)

        with server_bus.serve({ROBOT_ADVANCE: wait_once}):
            with pytest.raises(errors.DeadlineExceeded):
                client.call(ROBOT_ADVANCE, AdvanceRequest(), 0.2, idempotency_id="a")
            assert client.call(ROBOT_ADVANCE, AdvanceRequest(), 2.0, idempotency_id="a").world_time == 2.0

    @pytest.mark.parametrize("late", [0.0, 0.05, 0.15])
    def test_asking_again_just_when_the_time_is_over_is_not_told_so(
        self, client: Bus, server_bus: Bus, late: float
    ) -> None:
        calls: list[int] = []

        def slow_to_notice(_request: AdvanceRequest, call: Call) -> RobotState:
            calls.append(1)
            if len(calls) == 1:
                while call.time_left() > -0.1:
                    time.sleep(0.005)
                with pytest.raises(errors.RpcError) as over:
                    call.check()
                time.sleep(0.1)
                raise over.value
            return RobotState(world_time=2.0)

        with server_bus.serve({ROBOT_ADVANCE: slow_to_notice}), ThreadPoolExecutor(1) as pool:
            # The first caller's cancellation is lost: its process died.
            request = CallRequest(call_id="one", idempotency_id="a", caller="dead", time_left=0.2)
            where = key(client._cell, "Robot", "Advance")
            asked = pool.submit(
                lambda: list(client._session.get(where, payload=request.SerializeToString(), timeout=5.0))
            )
            while not calls:
                time.sleep(0.005)
            time.sleep(0.3 + late)
            assert client.call(ROBOT_ADVANCE, AdvanceRequest(), 2.0, idempotency_id="a").world_time == 2.0
            asked.result(10.0)
        assert len(calls) == 2

    def test_call_ends_when_all_its_callers_have_left(self, client: Bus, server_bus: Bus) -> None:
        handler = UntilCancelled()
        with server_bus.serve({ROBOT_ADVANCE: handler}), ThreadPoolExecutor(2) as pool:
            first = pool.submit(client.call, ROBOT_ADVANCE, AdvanceRequest(), 0.2, idempotency_id="a")
            assert handler.begun.wait(2.0)
            second = pool.submit(client.call, ROBOT_ADVANCE, AdvanceRequest(), 0.8, idempotency_id="a")
            assert isinstance(first.exception(), errors.DeadlineExceeded)
            assert not handler.ended.wait(0.2)  # the second caller still waits
            assert isinstance(second.exception(), errors.DeadlineExceeded)
            assert handler.ended.wait(1.0)
        assert handler.calls == 1

    def test_memory_is_bounded_in_number_and_time(
        self, client: Bus, server_bus: Bus, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("handeye.rpc.server.MEMORY", 4)
        monkeypatch.setattr("handeye.rpc.server.REMEMBERED", 0.2)

        def ask(name: str) -> None:
            client.call(ROBOT_GET_STATE, GetStateRequest(), 2.0, idempotency_id=name)

        with server_bus.serve({ROBOT_GET_STATE: get_state}) as server:
            for number in range(10):
                ask(str(number))
            assert [name for _method, name in server._remembered] == ["6", "7", "8", "9"]
            time.sleep(0.25)
            ask("late")
            assert [name for _method, name in server._remembered] == ["late"]
