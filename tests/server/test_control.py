"""Control of robot and head over REST: who has it, for how long, and what moves under it."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from handeye.rpc.errors import Internal, OutOfLimits, RpcError, Stopped, Unavailable
from handeye.server.control import SILENCE_LIMIT, Control
from tests.server.conftest import asking
from tests.server.rest import done, ended, problem
from tests.server.toys import PARK
from tests.server.waiting import until

if TYPE_CHECKING:
    import httpx2

    from tests.server.conftest import Lab


class Clock:
    """A clock that a test moves on."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock(lab: Lab) -> Clock:
    """Replaces the clock by which holders fall silent."""
    clock = Clock()
    lab.coordinator.control._clock = clock
    return clock


@pytest.fixture
def http(lab: Lab, clock: Clock) -> Iterator[TestClient]:
    with asking(lab) as client:
        yield client


def take(http: TestClient, holder: str = "alice") -> dict[str, str]:
    """The header of who got control."""
    given = done(http.post("/v1/robot/lease", json={"holder": holder}), 201)
    assert (given["holder"], given["expires_after"]) == (holder, SILENCE_LIMIT)
    return {"Control-Lease": given["lease"]}


def act(http: TestClient, lease: dict[str, str], action: str, **body: Any) -> httpx2.Response:
    return http.post(f"/v1/robot/actions/{action}", headers=lease, json=body or None)


@contextmanager
def moving(lab: Lab, http: TestClient, lease: dict[str, str]) -> Iterator[httpx2.Response]:
    """A motion under way that ends only when it is braked."""
    lab.robot.hang, lab.robot.on_step = True, threading.Event()
    accepted = act(http, lease, "park")
    assert lab.robot.on_step.wait(5.0)
    try:
        yield accepted
    finally:
        lab.robot.hang = False


# --- the lease ------------------------------------------------------------------------------------------------------


def test_control_is_given_kept_and_given_back(lab: Lab, http: TestClient) -> None:
    lease = take(http)
    assert lab.robot.leased
    assert "'alice' has control" in problem(http.post("/v1/robot/lease", json={"holder": "bob"}), 409, "busy")
    kept = done(http.put("/v1/robot/lease", headers=lease))
    assert kept == {"holder": "alice", "expires_after": SILENCE_LIMIT}
    assert http.delete("/v1/robot/lease", headers=lease).status_code == 204
    assert lab.robot.lease_id == ""
    problem(http.put("/v1/robot/lease", headers=lease), 409, "lease_needed")
    problem(http.delete("/v1/robot/lease", headers=lease), 409, "lease_needed")
    take(http, "bob")


def test_a_holder_who_falls_silent_loses_control(lab: Lab, http: TestClient, clock: Clock) -> None:
    lease = take(http)
    for _ in range(5):
        clock.now += 0.9 * SILENCE_LIMIT
        done(http.put("/v1/robot/lease", headers=lease))
    until(lambda: lab.robot.beats > 0)
    clock.now += 1.1 * SILENCE_LIMIT
    until(lambda: not lab.robot.leased)
    assert "POST /v1/robot/lease" in problem(http.put("/v1/robot/lease", headers=lease), 409, "lease_needed")
    problem(act(http, lease, "park"), 409, "lease_needed")
    until(lambda: http.post("/v1/robot/lease", json={"holder": "bob"}).status_code == 201)


def test_every_request_with_the_header_is_a_sign_of_life(lab: Lab, http: TestClient, clock: Clock) -> None:
    lease = take(http)
    for path in ("/v1/robot", "/v1/head", "/v1/jobs", "/v1/cameras/left/frame", "/v1/modules"):
        clock.now += 0.9 * SILENCE_LIMIT
        done(http.get(path, headers=lease)) if "frame" not in path else http.get(path, headers=lease)
        time.sleep(0.15)  # one look whether the holder is there
    assert lab.robot.leased
    # A wrong or an old one is none, and no error where none is needed.
    assert http.get("/v1/robot", headers={"Control-Lease": "wrong"}).status_code == 200


def test_with_the_real_clock_it_takes_two_seconds(lab: Lab) -> None:
    with asking(lab) as http:
        lease = take(http)
        began = time.monotonic()
        until(lambda: not lab.robot.leased)
        assert SILENCE_LIMIT <= time.monotonic() - began < SILENCE_LIMIT + 1.0
        problem(http.put("/v1/robot/lease", headers=lease), 409, "lease_needed")


@pytest.mark.parametrize("lease", ["", "wrong", "é", "x" * 100])
def test_a_wrong_lease_moves_nothing(lab: Lab, http: TestClient, lease: str) -> None:
    take(http)
    wrong = {"Control-Lease": lease.encode("latin-1")}
    for method, path, body in (
        ("PUT", "/v1/robot/lease", None),
        ("DELETE", "/v1/robot/lease", None),
        ("POST", "/v1/robot/actions/open_gripper", None),
        ("POST", "/v1/head/moves", {"pan": 0.0, "tilt": 0.0}),
    ):
        response = http.request(method, path, headers=wrong, json=body)  # type: ignore[arg-type]
        problem(response, 409, "lease_needed")
    assert lab.robot.commands == []
    assert lab.robot.leased


def test_without_the_header_it_is_named(http: TestClient) -> None:
    for method, path in (("PUT", "/v1/robot/lease"), ("DELETE", "/v1/robot/lease"), ("POST", "/v1/robot/actions/park")):
        assert "control-lease" in problem(http.request(method, path), 422, "invalid_argument").lower()


@pytest.mark.parametrize("error", [Internal, Unavailable])
def test_control_ends_also_when_the_bridge_cannot_take_it_back(
    lab: Lab, http: TestClient, monkeypatch: pytest.MonkeyPatch, error: type[RpcError]
) -> None:
    @contextmanager
    def failing() -> Iterator[None]:
        yield
        raise error("the bridge fails")

    with monkeypatch.context() as patched:
        patched.setattr(lab.robot, "lease", failing)
        lease = take(http)
    assert http.delete("/v1/robot/lease", headers=lease).status_code == 204
    assert http.delete("/v1/robot/lease", headers=take(http, "bob")).status_code == 204


def test_a_bridge_that_gives_no_lease_is_told(lab: Lab, http: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    lab.robot.leased = True  # by the teacher
    assert "'teacher'" in problem(http.post("/v1/robot/lease", json={"holder": "alice"}), 409, "busy")
    lab.robot.leased = False
    take(http)


def test_signs_of_life_do_not_wait_for_the_bridge(lab: Lab, http: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """Taking control asks the bridge, which may be silent for seconds; the event loop must not wait for that."""
    asked, answer = threading.Event(), threading.Event()
    lease = lab.robot.lease

    @contextmanager
    def slow() -> Iterator[None]:
        asked.set()
        assert answer.wait(10.0)
        with lease():
            yield

    monkeypatch.setattr(lab.robot, "lease", slow)
    taking = threading.Thread(target=take, args=(http,))
    taking.start()
    try:
        assert asked.wait(5.0)
        began = time.monotonic()
        problem(http.put("/v1/robot/lease", headers={"Control-Lease": "other"}), 409, "lease_needed")
        problem(http.post("/v1/robot/lease", json={"holder": "bob"}), 409, "busy")
        assert time.monotonic() - began < 1.0
    finally:
        answer.set()
        taking.join(10.0)
    assert lab.robot.leased


def test_who_takes_control_while_the_coordinator_ends_does_not_get_it(
    lab: Lab, http: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    lease = lab.robot.lease

    @contextmanager
    def slow() -> Iterator[None]:
        with lease():
            lab.coordinator.control.close()
            yield

    monkeypatch.setattr(lab.robot, "lease", slow)
    assert "shutting down" in problem(http.post("/v1/robot/lease", json={"holder": "alice"}), 409, "busy")
    assert not lab.robot.leased


# --- motions --------------------------------------------------------------------------------------------------------


def test_the_six_actions_and_the_head(lab: Lab, http: TestClient) -> None:
    lease = take(http)
    for action, body in (
        ("open_gripper", {}),
        ("close_gripper", {}),
        ("move_to_point", {"point": [0.5, 0.0, 0.3], "pace": {"speed": 0.2, "acceleration": 1.0}}),
        ("move_to_joints", {"joints": [0.1] * 6}),
        ("adjust_joints", {"delta": [0.05] * 6}),
        ("advance", {"duration": 0.5}),
        ("park", {}),
    ):
        accepted = act(http, lease, action, **body)
        job = ended(http, accepted)
        assert (job["kind"], job["subject"], job["state"], job["progress"]) == ("motion", action, "succeeded", 1.0)
        assert len(job["result"]["joints"]) == 6
        assert job["result"]["moving"] is False
    assert lab.robot.commands == [
        *("open_gripper", "close_gripper", "move_to_point", "move_to_joints", "adjust_joints", "advance", "park")
    ]
    np.testing.assert_allclose(job["result"]["joints"], PARK)
    turned = ended(http, http.post("/v1/head/moves", headers=lease, json={"pan": 0.3, "tilt": -0.2}))
    assert (turned["subject"], turned["state"]) == ("head", "succeeded")
    assert (turned["result"]["pan"], turned["result"]["tilt"]) == (0.3, -0.2)
    head = done(http.get("/v1/head"))
    assert (head["pan"], head["tilt"], head["pan_lower"], head["tilt_upper"]) == (0.3, -0.2, -1.0, 0.5)


@pytest.mark.parametrize(
    ("action", "body", "wrong"),
    [
        ("move_to_point", {"point": [0.0, 0.0]}, "body.point.2"),
        ("move_to_point", {"point": [0.0, 0.0, "nan"]}, "body.point.2"),
        ("move_to_joints", {"joints": []}, "body.joints"),
        ("move_to_joints", {"joints": [0.0] * 33}, "body.joints"),
        ("adjust_joints", {"delta": [0.0] * 6, "pace": {"speed": 2.0}}, "body.pace.speed"),
        ("adjust_joints", {"joints": [0.0] * 6}, "body.delta"),
        ("advance", {"duration": 0.0}, "body.duration"),
        ("advance", {"duration": 61.0}, "body.duration"),
        ("park", {"speed": 1.0}, "body.speed"),
    ],
)
def test_wrong_motions_name_the_field(
    lab: Lab, http: TestClient, action: str, body: dict[str, Any], wrong: str
) -> None:
    response = act(http, take(http), action, **body)
    problem(response, 422, "invalid_argument")
    assert wrong in [field["location"] for field in response.json()["fields"]]
    assert lab.robot.commands == []


def test_a_motion_that_fails_says_why(lab: Lab, http: TestClient) -> None:
    lease = take(http)
    for error, code in ((OutOfLimits, "out_of_limits"), (Stopped, "stopped")):
        lab.robot.fail_with = error("joint 3 would reach 4.00 rad")
        job = ended(http, act(http, lease, "move_to_joints", joints=[4.0] * 6))
        assert (job["state"], job["error"]) == (
            "failed",
            {"code": code, "message": "joint 3 would reach 4.00 rad"},
        )
    lab.robot.fail_with = None
    assert ended(http, act(http, lease, "park"))["state"] == "succeeded"


def test_one_motion_at_a_time(lab: Lab, http: TestClient) -> None:
    lease = take(http)
    with moving(lab, http, lease) as accepted:
        job = accepted.json()["id"]
        assert job in problem(act(http, lease, "open_gripper"), 409, "busy")
        assert job in problem(http.post("/v1/head/moves", headers=lease, json={"pan": 0.0, "tilt": 0.0}), 409, "busy")
        http.post(f"/v1/jobs/{job}/cancel")
        assert ended(http, accepted)["state"] == "cancelled"
        assert lab.robot.leased


def test_silence_brakes_a_motion(lab: Lab, http: TestClient, clock: Clock) -> None:
    lease = take(http)
    with moving(lab, http, lease) as accepted:
        clock.now += 1.1 * SILENCE_LIMIT
        job = ended(http, accepted)
        assert (job["state"], job["error"]["code"]) == ("failed", "lease_needed")
        assert "braked" in job["error"]["message"]
        until(lambda: not lab.robot.leased)
        assert not lab.world.moving


def test_giving_control_back_brakes_a_motion(lab: Lab, http: TestClient) -> None:
    lease = take(http)
    with moving(lab, http, lease) as accepted:
        assert http.delete("/v1/robot/lease", headers=lease).status_code == 204
        assert not lab.world.moving
        assert not lab.robot.leased
        assert ended(http, accepted)["state"] == "failed"
        problem(act(http, lease, "park"), 409, "lease_needed")


def test_while_control_ends_nothing_new_begins(lab: Lab, http: TestClient, clock: Clock) -> None:
    """Braking takes a while; in it the old lease is none any more, and nobody else has one."""
    lease = take(http)
    braking, braked = threading.Event(), threading.Event()
    command = lab.robot._command

    def slow(*arguments: Any) -> None:
        try:
            command(*arguments)
        finally:
            braking.set()
            braked.wait(5.0)

    lab.robot._command = slow  # type: ignore[method-assign, assignment]
    with moving(lab, http, lease):
        clock.now += 1.1 * SILENCE_LIMIT
        assert braking.wait(5.0)
        problem(http.put("/v1/robot/lease", headers=lease), 409, "lease_needed")
        problem(act(http, lease, "open_gripper"), 409, "lease_needed")
        problem(http.post("/v1/robot/lease", json={"holder": "bob"}), 409, "busy")
        braked.set()
        until(lambda: not lab.robot.leased)


def test_closing_brakes_a_motion_and_gives_nothing_out_any_more(lab: Lab, http: TestClient) -> None:
    lease = take(http)
    with moving(lab, http, lease) as accepted:
        lab.coordinator.close()
        assert not lab.world.moving
        assert not lab.robot.leased
        assert done(http.get(accepted.headers["location"]))["state"] in ("failed", "cancelled")
        assert "shutting down" in problem(http.post("/v1/robot/lease", json={"holder": "bob"}), 409, "busy")


def test_a_motion_whose_transaction_fails_never_starts(lab: Lab, http: TestClient) -> None:
    lease = take(http)["Control-Lease"]
    control, jobs = lab.coordinator.control, lab.coordinator.jobs

    def fail() -> None:
        with lab.coordinator.store.write():
            control.move(lease, "park", jobs, lambda robot, watch: robot.park(watch=watch), lambda *_: None)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    began = time.monotonic()
    control.release(lease)
    assert time.monotonic() - began < 2.0
    assert lab.robot.commands == []


def test_a_motion_that_begins_too_late_does_not_begin(lab: Lab, http: TestClient) -> None:
    """Control ends while the transaction that starts the motion is being committed."""
    lease = take(http)["Control-Lease"]
    control, jobs = lab.coordinator.control, lab.coordinator.jobs
    with lab.coordinator.store.write():
        job = control.move(lease, "park", jobs, lambda robot, watch: robot.park(watch=watch), lambda *_: None)
        control._held.ended.set()  # type: ignore[union-attr]
    assert job.wait(5.0)
    assert job.view().state == "failed"
    assert lab.robot.commands == []
    control._held.ended.clear()  # type: ignore[union-attr]


# --- beside tasks ---------------------------------------------------------------------------------------------------


def test_who_has_control_keeps_tasks_out_and_a_task_keeps_people_out(lab: Lab, http: TestClient) -> None:
    lab.teach(lab.places)
    lab.train()
    lease = take(http)
    busy = http.post("/v1/tasks/grasp/runs", json={"object": "blue cup"})
    assert "'alice' has control" in problem(busy, 409, "busy")
    http.delete("/v1/robot/lease", headers=lease)
    lab.cameras.gate = threading.Event()
    accepted = http.post("/v1/tasks/grasp/runs", json={"object": "blue cup"})
    try:
        assert lab.cameras.waiting.wait(5.0)
        refused = problem(http.post("/v1/robot/lease", json={"holder": "alice"}), 409, "busy")
        assert accepted.json()["id"] in refused
    finally:
        lab.cameras.gate.set()
    assert ended(http, accepted)["state"] == "succeeded"
    take(http)


def test_control_needs_no_coordinator_to_be_free() -> None:
    control = Control(lambda _holder: None, None)  # type: ignore[arg-type, return-value]
    control.require_free()
    control.close()
    control.close()
