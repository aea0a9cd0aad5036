"""Control of the robot: the lease lives as long as the block, every motion is followed, and losing control is told."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import Callable
from typing import Any

import httpx2
import pytest

from handeye.client import ApiError, AsyncClient, Client, Control, JobFailed, LeaseLost, TimedOut, WrongArrays
from handeye.client._async import control as async_control
from handeye.client._sync import control as sync_control
from tests.client.conftest import PATIENCE, ROBOT, Connect, event, job, problem, streamed

HEAD = {"pan": 0.1, "tilt": -0.2, "moving": False, "world_time": 2.0}


class Cell:
    """A coordinator with a robot. Signs of life are counted and may be answered otherwise; so may be motions."""

    def __init__(self, expires_after: float = 2.0) -> None:
        self.asked: list[tuple[str, str, Any]] = []
        self.beats: list[float] = []
        self.keys: list[str] = []
        self.on_beat: Callable[[], httpx2.Response] = lambda: httpx2.Response(200, json={"expires_in": 2.0})
        self.on_events: Callable[[], httpx2.Response] | None = None
        self.ended = job("succeeded", "motion", result={**ROBOT, "joints": [1.0] * 6})
        self._expires_after = expires_after
        self._lock = threading.Lock()

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        path, body = request.url.path, json.loads(request.content or "{}")
        if (request.method, path) == ("PUT", "/v1/robot/lease"):
            assert request.headers["control-lease"] == "the-lease"
            self.beats.append(time.monotonic())
            return self.on_beat()
        with self._lock:
            self.asked.append((request.method, path, body))
        if path == "/v1/robot/lease":
            if request.method == "DELETE":
                assert request.headers["control-lease"] == "the-lease"
                return httpx2.Response(204)
            lease = {"lease": "the-lease", "holder": body["holder"], "expires_after": self._expires_after}
            return httpx2.Response(201, json=lease)
        if path.startswith("/v1/robot/actions/") or path == "/v1/head/moves":
            assert request.headers["control-lease"] == "the-lease"
            self.keys.append(request.headers["idempotency-key"])
            return httpx2.Response(202, json=job("queued", "motion"))
        if path.endswith("/events"):
            return self.on_events() if self.on_events else streamed(event(1, "state", self.ended))
        if path == "/v1/robot":
            return httpx2.Response(200, json=ROBOT)
        return httpx2.Response(202, json=self.ended)

    @property
    def paths(self) -> list[str]:
        return [f"{method} {path}" for method, path, _body in self.asked]

    def running(self) -> httpx2.Response:
        """The event stream of a motion that goes on, and its job says so too."""
        self.ended = job("running", "motion")
        time.sleep(0.02)
        return streamed(event(1, "state", self.ended))


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (async_control, sync_control):
        monkeypatch.setattr(module, "BEAT_PERIOD", 0.03)
        monkeypatch.setattr(module, "BEAT_TIMEOUT", 0.05)


def test_every_motion_is_a_job_under_the_lease(connect: Connect) -> None:
    cell = Cell()
    with connect(cell) as client, client.control("alice") as arm:
        arm.park()
        reached = arm.move_to_joints([0.1] * 6, speed=0.2)
        arm.adjust_joints([0.0] * 6, acceleration=0.1)
        arm.open_gripper()
        arm.close_gripper()
        arm.move_to_point((0.5, 0.0, 0.2), 0.3, 0.4)
        arm.advance(0.5)
        assert arm.state().gripper_opening == 0.09
    assert reached.joints == (1.0,) * 6
    started = [(path, body) for method, path, body in cell.asked if path.startswith("/v1/robot/actions/")]
    assert started == [
        ("/v1/robot/actions/park", {}),
        ("/v1/robot/actions/move_to_joints", {"joints": [0.1] * 6, "pace": {"speed": 0.2}}),
        ("/v1/robot/actions/adjust_joints", {"delta": [0.0] * 6, "pace": {"acceleration": 0.1}}),
        ("/v1/robot/actions/open_gripper", {}),
        ("/v1/robot/actions/close_gripper", {}),
        (
            "/v1/robot/actions/move_to_point",
            {"point": [0.5, 0.0, 0.2], "pace": {"speed": 0.3, "acceleration": 0.4}},
        ),
        ("/v1/robot/actions/advance", {"duration": 0.5}),
    ]
    assert len(set(cell.keys)) == 7
    assert cell.asked[0] == ("POST", "/v1/robot/lease", {"holder": "alice"})
    assert cell.paths[-1] == "DELETE /v1/robot/lease"


def test_the_head_turns(connect: Connect) -> None:
    cell = Cell()
    cell.ended = job("succeeded", "motion", subject="head", result=HEAD)
    with connect(cell) as client, client.control("alice") as arm:
        assert arm.turn_head(0.1, -0.2).pan == 0.1
    assert ("POST", "/v1/head/moves", {"pan": 0.1, "tilt": -0.2}) in cell.asked


def test_a_motion_that_fails_says_why_and_control_stays(connect: Connect) -> None:
    cell = Cell()
    cell.ended = job("failed", "motion", {"code": "stopped", "message": "the robot is stopped"}, subject="park")
    with connect(cell) as client, client.control("alice") as arm:
        with pytest.raises(JobFailed, match="Motion 'park' failed: the robot is stopped"):
            arm.park()
        arm.state()


def test_a_busy_robot_is_not_taken(connect: Connect) -> None:
    busy = problem(409, "busy", "'bob' has control.")
    with connect(lambda _: busy) as client, pytest.raises(ApiError, match="'bob' has control"), client.control("alice"):
        pass


def test_what_is_no_row_of_numbers_moves_nothing(connect: Connect) -> None:
    cell = Cell()
    with connect(cell) as client, client.control("alice") as arm, pytest.raises(WrongArrays):
        arm.move_to_joints([float("nan")] * 6)
    assert not cell.keys


@pytest.mark.parametrize("how", [KeyboardInterrupt, ZeroDivisionError])
def test_leaving_a_motion_early_cancels_it_and_gives_control_back(connect: Connect, how: type[BaseException]) -> None:
    cell = Cell()

    def interrupted() -> httpx2.Response:
        raise how

    cell.on_events = interrupted
    with connect(cell) as client, pytest.raises(how), client.control("alice") as arm:
        arm.park()
    assert cell.paths[-2:] == ["POST /v1/jobs/j1/cancel", "DELETE /v1/robot/lease"]


def test_a_motion_that_takes_too_long_is_cancelled(connect: Connect) -> None:
    cell = Cell()
    cell.on_events = cell.running
    with (
        connect(cell) as client,
        client.control("alice", motion_timeout=0.2) as arm,
        pytest.raises(TimedOut, match=r"did not end within 0\.2 s"),
    ):
        arm.park()
    assert "POST /v1/jobs/j1/cancel" in cell.paths


def sync_client(cell: Cell) -> Client:
    return Client("http://coordinator", "secret", transport=httpx2.MockTransport(cell), retries=PATIENCE)


def test_signs_of_life_are_sent_until_the_end() -> None:
    cell = Cell()
    with sync_client(cell) as client:
        with client.control("alice"):
            time.sleep(0.3)
        count = len(cell.beats)
        time.sleep(0.1)
    assert 3 <= count <= 11
    assert len(cell.beats) == count
    assert not [thread for thread in threading.enumerate() if thread.name == "control-lease"]


def test_signs_of_life_are_sent_until_the_end_of_a_block_that_fails() -> None:
    cell = Cell()
    with sync_client(cell) as client, pytest.raises(ZeroDivisionError), client.control("alice"):
        raise ZeroDivisionError
    count = len(cell.beats)
    time.sleep(0.1)
    assert len(cell.beats) == count


def refused() -> httpx2.Response:
    return problem(409, "lease_needed", "This needs control of the robot.")


def test_losing_control_is_told_by_the_next_call_and_at_the_end() -> None:
    cell = Cell()
    cell.on_beat = refused
    message = r"'alice' has lost control of the robot\. No sign of life came in time"
    with sync_client(cell) as client, pytest.raises(LeaseLost, match=message), client.control("alice") as arm:
        assert use_after_loss(arm)
    assert not cell.keys
    assert len(cell.beats) == 1


def test_a_motion_that_is_refused_for_want_of_control_says_so() -> None:
    cell = Cell()

    def answer(request: httpx2.Request) -> httpx2.Response:
        return refused() if request.url.path.endswith("/park") else cell(request)

    transport = httpx2.MockTransport(answer)
    with (
        Client("http://coordinator", transport=transport) as client,
        pytest.raises(LeaseLost),
        client.control("alice") as arm,
    ):
        arm.park()


def test_a_revoked_token_loses_control() -> None:
    cell = Cell()
    cell.on_beat = lambda: problem(401, "token_wrong", "Nobody has this token.")
    with sync_client(cell) as client, pytest.raises(LeaseLost, match="Nobody has this token"), client.control("alice"):
        time.sleep(0.1)


def test_a_client_that_was_closed_has_lost_control() -> None:
    def close_early(client: Client) -> None:
        client.close()
        time.sleep(0.1)

    message = "This client of http://coordinator was closed"
    client = sync_client(Cell())
    with pytest.raises(LeaseLost, match=message), client.control("alice"):
        close_early(client)


def test_losing_control_ends_a_motion() -> None:
    cell = Cell()
    cell.on_events = cell.running

    def later() -> httpx2.Response:
        return refused() if len(cell.beats) > 3 else httpx2.Response(200, json={"expires_in": 2.0})

    cell.on_beat = later
    began = time.monotonic()
    with sync_client(cell) as client, pytest.raises(LeaseLost), client.control("alice") as arm:
        arm.park()
    assert time.monotonic() - began < 5.0
    assert "POST /v1/jobs/j1/cancel" in cell.paths


def test_a_motion_braked_because_control_was_lost_says_so() -> None:
    cell = Cell()
    failed = job("failed", "motion", {"code": "lease_needed", "message": "Control has ended."})

    def braked() -> httpx2.Response:
        cell.on_beat = refused
        time.sleep(0.2)
        cell.ended = failed
        return streamed(event(1, "state", failed))

    cell.on_events = braked
    with sync_client(cell) as client, pytest.raises(LeaseLost), client.control("alice") as arm:
        arm.park()


def test_a_short_disturbance_loses_nothing() -> None:
    cell = Cell()

    def disturbed() -> httpx2.Response:
        if len(cell.beats) in (2, 3):
            raise httpx2.ConnectError("no route")
        return problem(503, "unavailable", "later") if len(cell.beats) == 5 else httpx2.Response(200, json={})

    cell.on_beat = disturbed
    with sync_client(cell) as client, client.control("alice") as arm:
        time.sleep(0.4)
        arm.park()
    assert len(cell.beats) > 5


def test_a_coordinator_that_does_not_answer_is_a_lost_one() -> None:
    cell = Cell(expires_after=0.2)

    def gone() -> httpx2.Response:
        raise httpx2.ConnectError("no route")

    cell.on_beat = gone
    began = time.monotonic()
    with sync_client(cell) as client, pytest.raises(LeaseLost, match="no route"), client.control("alice") as arm:
        watch(arm)
    assert time.monotonic() - began < 1.0


def use_after_loss(arm: Control) -> bool:
    time.sleep(0.1)
    with pytest.raises(LeaseLost):
        arm.park()
    return True


def watch(arm: Control) -> None:
    began = time.monotonic()
    while time.monotonic() - began < 5.0:
        arm.state()
        time.sleep(0.01)


def test_tasks_keep_the_lease_while_they_wait() -> None:
    cell = Cell()

    async def main() -> None:
        transport = httpx2.MockTransport(cell)
        async with AsyncClient("http://coordinator", transport=transport) as client:
            async with client.control("alice") as arm:
                await arm.park()
                await asyncio.sleep(0.3)
            count = len(cell.beats)
            await asyncio.sleep(0.1)
            assert len(cell.beats) == count >= 3

    asyncio.run(main())
    assert cell.paths[-1] == "DELETE /v1/robot/lease"


def test_a_task_that_loses_control_is_told() -> None:
    cell = Cell()
    cell.on_beat = refused

    async def main() -> None:
        transport = httpx2.MockTransport(cell)
        async with AsyncClient("http://coordinator", transport=transport) as client, client.control("alice") as arm:
            await asyncio.sleep(0.1)
            await arm.park()

    with pytest.raises(LeaseLost):
        asyncio.run(main())
    assert not cell.keys


def test_a_cancelled_task_cancels_its_motion_and_gives_control_back() -> None:
    cell = Cell()

    async def moving(client: AsyncClient) -> None:
        async with client.control("alice") as arm:
            await arm.park()

    async def endless(request: httpx2.Request) -> httpx2.Response:
        if request.url.path.endswith("/events"):
            await asyncio.sleep(60.0)
        return cell(request)

    async def main() -> None:
        async with AsyncClient("http://coordinator", transport=httpx2.MockTransport(endless)) as client:
            task = asyncio.create_task(moving(client))
            await asyncio.sleep(0.2)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            assert len(asyncio.all_tasks()) == 1

    asyncio.run(main())
    assert cell.paths[-2:] == ["POST /v1/jobs/j1/cancel", "DELETE /v1/robot/lease"]
