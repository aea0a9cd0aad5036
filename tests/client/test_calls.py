"""What is repeated and what is not, for how long, and what the errors are."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from uuid import UUID

import httpx2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handeye.client import ApiError, Client, NotConfigured, Retries, UnexpectedAnswer, Unreachable
from handeye.client._foreign import Answer, refusal
from handeye.client._retries import ONCE, URGENT
from tests.client.conftest import ROBOT, Connect, Script, job, problem

DEMONSTRATION = {
    "id": "grasp-1",
    "task": "grasp",
    "object": "cup",
    "state": "recording",
    "observations": 0,
    "subtasks": [],
    "outcome": None,
    "created": "2026-11-01T10:00:00Z",
}
MODULE = {
    "name": "m",
    "declaration": {"name": "m", "inputs": [], "outputs": []},
    "samples": 0,
    "demonstrations": 0,
    "created": "2026-11-01T10:00:00Z",
}

BUSY = problem(503, "unavailable", "The robot bridge does not answer.")
LOST = httpx2.ReadError("connection reset")

Call = Callable[[Client], object]

KEYED: dict[str, tuple[Call, dict[str, object]]] = {
    "create a module": (lambda c: c.create_module({"name": "m"}), MODULE),
    "add samples": (lambda c: c.add_samples("m", [[1.0]], [[2.0]]), {"first": 0, "count": 1, "samples": 1}),
    "begin a demonstration": (lambda c: c.begin_demonstration("grasp", "cup"), DEMONSTRATION),
    "finish it": (lambda c: c.finish_demonstration("grasp-1"), DEMONSTRATION),
    "run": (lambda c: c.start_run("grasp", "cup"), job("queued")),
    "train": (lambda c: c.start_training("grasp"), job("queued", "train")),
    "train a module": (lambda c: c.start_module_training("m"), job("queued", "train")),
}
HARMLESS: dict[str, tuple[Call, dict[str, object]]] = {
    "read": (lambda c: c.robot(), ROBOT),
    "stop": (lambda c: c.stop_robot(), ROBOT),
    "cancel": (lambda c: c.cancel_job("j1"), job("cancelled")),
    "label": (lambda c: c.label_demonstration("grasp-1", "failure"), DEMONSTRATION),
    "delete": (lambda c: c.delete_module("m"), {}),
}
ONLY_ONCE: dict[str, Call] = {
    "reset": lambda c: c.reset_robot(),
    "roll back": lambda c: c.roll_back("m", "before"),
    "remove samples": lambda c: c.remove_samples("m", [1]),
    "show an object": lambda c: c.add_example("cup"),
    "make a token": lambda c: c.create_token("me", "viewer"),
    "take control": lambda c: c.control("me").__enter__(),
    "ask whether it is ready": lambda c: c.wait_ready(0.0),
}


@pytest.mark.parametrize("failure", [BUSY, LOST])
@pytest.mark.parametrize("what", KEYED)
def test_a_write_is_repeated_with_its_key(connect: Connect, what: str, failure: httpx2.Response | Exception) -> None:
    call, answer = KEYED[what]
    coordinator = Script(failure, failure, httpx2.Response(200, json=answer))
    with connect(coordinator) as client:
        call(client)
    assert len(coordinator.keys) == 3
    assert len(set(coordinator.keys)) == 1
    assert UUID(str(coordinator.keys[0])).version == 4
    assert len({request.content for request in coordinator.asked}) == 1


def test_every_write_has_a_key_of_its_own(connect: Connect) -> None:
    coordinator = Script(httpx2.Response(200, json=job("queued")))
    with connect(coordinator) as client:
        client.start_run("grasp", "cup")
        client.start_run("grasp", "cup")
    assert len(set(coordinator.keys)) == 2


@pytest.mark.parametrize("failure", [BUSY, LOST])
@pytest.mark.parametrize("what", HARMLESS)
def test_what_does_no_harm_is_repeated_without_a_key(
    connect: Connect, what: str, failure: httpx2.Response | Exception
) -> None:
    call, answer = HARMLESS[what]
    coordinator = Script(failure, httpx2.Response(200, json=answer))
    with connect(coordinator) as client:
        call(client)
    assert coordinator.keys == [None, None]


@pytest.mark.parametrize("failure", [BUSY, LOST])
@pytest.mark.parametrize("what", ONLY_ONCE)
def test_what_would_be_done_twice_is_not_repeated(
    connect: Connect, what: str, failure: httpx2.Response | Exception
) -> None:
    coordinator = Script(failure)
    with connect(coordinator) as client, pytest.raises(Exception, match=r"robot bridge|reset"):
        ONLY_ONCE[what](client)
    assert coordinator.keys == [None]


def test_a_stop_is_tried_hard_and_its_failure_is_told(connect: Connect) -> None:
    coordinator = Script(BUSY)
    with connect(coordinator) as client, pytest.raises(ApiError, match="does not answer"):
        client.stop_robot()
    assert len(coordinator.asked) == URGENT.attempts
    assert coordinator.asked[0].extensions["timeout"]["read"] == pytest.approx(6.0)
    assert coordinator.asked[0].extensions["timeout"]["connect"] == pytest.approx(1.0)


@pytest.mark.parametrize("status", [400, 401, 403, 404, 409, 413, 422, 500, 504])
def test_a_refusal_that_would_be_repeated_is_final(connect: Connect, status: int) -> None:
    coordinator = Script(problem(status, "some_code", "It cannot be done."))
    with connect(coordinator) as client, pytest.raises(ApiError, match="It cannot be done") as refused:
        client.robot()
    assert len(coordinator.asked) == 1
    assert (refused.value.status, refused.value.code, refused.value.title) == (status, "some_code", "Title")


def test_a_request_that_is_still_being_done_is_asked_for_again(connect: Connect) -> None:
    under_way = problem(409, "in_progress", "The same request is being done.", retry_after="0")
    coordinator = Script(under_way, httpx2.Response(200, json=job("queued")))
    with connect(coordinator) as client:
        assert client.start_run("grasp", "cup").id == "j1"
    assert len(coordinator.asked) == 2


def test_a_deletion_whose_answer_was_lost_is_done(connect: Connect) -> None:
    gone = problem(404, "not_found", "There is no such module.")
    with connect(Script(LOST, gone)) as client:
        client.delete_module("m")
    with connect(Script(gone)) as client, pytest.raises(ApiError, match="no such module"):
        client.delete_module("m")


def test_retry_after_is_honoured(connect: Connect) -> None:
    coordinator = Script(
        problem(429, "too_many_requests", "Slower.", retry_after="1"), httpx2.Response(200, json=ROBOT)
    )
    began = time.monotonic()
    with connect(coordinator) as client:
        client.robot()
    assert time.monotonic() - began >= 1.0


def test_a_retry_after_beyond_the_deadline_is_not_waited_for(connect: Connect) -> None:
    coordinator = Script(problem(429, "too_many_requests", "Much slower.", retry_after="3600"))
    began = time.monotonic()
    with connect(coordinator) as client, pytest.raises(ApiError, match="Much slower") as refused:
        client.robot()
    assert time.monotonic() - began < 5.0
    assert refused.value.retry_after == 3600.0


def answered(**headers: str) -> Answer:
    return Answer(429, "Too Many Requests", httpx2.Headers({k.replace("_", "-"): v for k, v in headers.items()}), b"")


def test_retry_after_may_be_a_date() -> None:
    later = format_datetime(datetime.now(UTC) + timedelta(seconds=60), usegmt=True)
    assert refusal(answered(retry_after=later)).retry_after == pytest.approx(60.0, abs=3.0)
    assert refusal(answered(retry_after="yesterday")).retry_after is None
    assert refusal(answered()).retry_after is None


@given(tried=st.integers(1, 3), chance=st.floats(0.0, 1.0))
def test_pauses_double_and_are_spread(tried: int, chance: float) -> None:
    pause = Retries(first_pause=0.2, longest_pause=0.5).pause(tried, Unreachable("gone"), lambda: chance)
    longest = min(0.5, 0.2 * 2 ** (tried - 1))
    assert pause is not None
    assert 0.5 * longest <= pause <= longest


def test_there_is_an_end_of_trying() -> None:
    assert Retries(attempts=4).pause(4, Unreachable("gone")) is None
    assert ONCE.pause(1, Unreachable("gone")) is None
    assert Retries().pause(1, UnexpectedAnswer("html")) is None


class Slow(httpx2.SyncByteStream, httpx2.AsyncByteStream):
    """A body that trickles in for ever."""

    def __iter__(self) -> object:  # type: ignore[override]
        while True:
            time.sleep(0.02)
            yield b" "

    async def __aiter__(self) -> object:  # type: ignore[override]
        while True:
            time.sleep(0.02)
            yield b" "


def test_an_answer_that_trickles_in_ends_at_the_deadline() -> None:
    transport = httpx2.MockTransport(lambda _: httpx2.Response(200, stream=Slow()))
    began = time.monotonic()
    with (
        Client("http://coordinator", timeout=0.3, transport=transport) as client,
        pytest.raises(Unreachable, match=r"did not answer within 0\.\d+ s"),
    ):
        client.robot()
    assert time.monotonic() - began < 2.0


def test_the_deadline_counts_all_attempts() -> None:
    script = Script(LOST)
    patient = Retries(attempts=1000, first_pause=0.05, longest_pause=0.05)
    began = time.monotonic()
    transport = httpx2.MockTransport(script)
    with (
        Client("http://coordinator", timeout=0.4, transport=transport, retries=patient) as client,
        pytest.raises(Unreachable, match="connection reset"),
    ):
        client.robot()
    assert time.monotonic() - began < 2.0
    assert 2 < len(script.asked) < 30


@pytest.mark.parametrize("url", ["http://host:port", "coordinator", "ftp://coordinator"])
def test_a_wrong_address_is_named(url: str) -> None:
    with pytest.raises(NotConfigured, match="no address of a coordinator"), Client(url) as client:
        client.robot()


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (httpx2.ConnectError("refused"), "refused. Is it running"),
        (httpx2.ConnectTimeout(""), "ConnectTimeout"),
        (httpx2.ReadTimeout(""), "does not answer in time"),
        (httpx2.RemoteProtocolError("disconnected"), "disconnected"),
    ],
)
def test_what_the_network_does_is_one_error(connect: Connect, error: Exception, message: str) -> None:
    with connect(Script(error)) as client, pytest.raises(Unreachable, match=message):
        client.reset_robot()
