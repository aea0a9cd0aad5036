"""A write that carries an Idempotency-Key is done once, however often it is sent."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import pytest

from handeye.rpc.errors import Unavailable
from handeye.server.access import Role
from handeye.server.store import replies
from tests.server.conftest import TOKEN, asking, open_lab
from tests.server.rest import NPZ, declaration, done, ended, packed, problem, samples, taught

if TYPE_CHECKING:
    from starlette.testclient import TestClient

    from handeye.server.store import Store
    from tests.server.conftest import Lab

KEY = {"Idempotency-Key": "a-key"}


def test_the_same_request_gets_the_same_answer_and_is_done_once(http: TestClient, module: str) -> None:
    first = http.post(f"{module}/samples", json=samples(3), headers=KEY)
    again = http.post(f"{module}/samples", json=samples(3), headers=KEY)
    assert (first.status_code, first.json()) == (201, {"first": 0, "count": 3, "samples": 3})
    assert (again.status_code, again.json(), again.headers["content-type"]) == (201, first.json(), "application/json")
    assert done(http.get(module))["samples"] == 3
    assert done(http.post(f"{module}/samples", json=samples(3)), 201)["first"] == 3  # without a key it is another one


def test_answers_with_their_location_are_repeated_whole(http: TestClient) -> None:
    body = declaration("ein größerer Name")
    first = http.post("/v1/modules", json=body, headers=KEY)
    assert first.status_code == 201
    http.post("/v1/modules/ein größerer Name/samples", json=samples(1))
    again = http.post("/v1/modules", json=body, headers=KEY)
    assert (again.status_code, again.content) == (201, first.content)
    assert again.headers["location"] == first.headers["location"]
    assert done(http.get(first.headers["location"]))["name"] == body["name"]


def test_another_request_with_the_same_key_is_refused(http: TestClient, module: str) -> None:
    done(http.post(f"{module}/samples", json=samples(1), headers=KEY), 201)
    done(http.post("/v1/modules", json=declaration("other")), 201)
    inputs, outputs = taught(1)
    for path, options in (
        (f"{module}/samples", {"json": samples(2)}),
        (f"{module}/samples?more=1", {"json": samples(1)}),
        ("/v1/modules/other/samples", {"json": samples(1)}),
        (f"{module}/samples", {"content": packed(inputs=inputs, outputs=outputs), "headers": NPZ | KEY}),
        (f"{module}/train", {}),
    ):
        response = http.post(path, **({"headers": KEY} | options))
        assert "new key" in problem(response, 409, "idempotency_key_used"), path
    assert done(http.get(module))["samples"] == 1


def test_each_token_has_keys_of_its_own(lab: Lab, http: TestClient, module: str) -> None:
    _, secret = lab.access.tokens.create("other", Role.OPERATOR, None)
    other = {"Authorization": f"Bearer {secret}"}
    assert done(http.post(f"{module}/samples", json=samples(1), headers=KEY), 201)["first"] == 0
    assert done(http.post(f"{module}/samples", json=samples(2), headers=KEY | other), 201)["first"] == 1


@pytest.mark.parametrize("key", ["", " ", "a b", "x" * 129, "é"])
def test_a_key_that_is_none_is_refused(http: TestClient, module: str, key: str) -> None:
    response = http.post(f"{module}/samples", json=samples(1), headers={b"Idempotency-Key": key.encode()})
    assert "idempotency-key" in problem(response, 422, "invalid_argument").lower()
    assert done(http.get(module))["samples"] == 0


def test_refusals_are_not_remembered(http: TestClient) -> None:
    problem(http.post("/v1/modules/map/samples", json=samples(1), headers=KEY), 404, "not_found")
    http.post("/v1/modules", json=declaration())
    assert done(http.post("/v1/modules/map/samples", json=samples(1), headers=KEY), 201)["first"] == 0


def test_what_fails_leaves_nothing_neither_the_write_nor_the_key(
    lab: Lab, http: TestClient, module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(replies, "remember", lambda *_: 1 / 0)
        problem(http.post(f"{module}/samples", json=samples(3), headers=KEY), 500, "internal")
        problem(http.post("/v1/modules", json=declaration("other"), headers=KEY), 500, "internal")
        problem(http.post(f"{module}/train", headers=KEY), 500, "internal")
    assert done(http.get(module))["samples"] == 0
    assert lab.coordinator.modules.live("map").samples == 0
    problem(http.get("/v1/modules/other"), 404, "not_found")
    problem(http.post("/v1/modules/other/query", json={"inputs": [[0.0, 0.0]]}), 404, "not_found")
    assert done(http.get("/v1/jobs"))["jobs"] == []
    assert lab.coordinator.jobs._live == {}
    done(http.post(f"{module}/samples", json=samples(3), headers=KEY), 201)


def test_duplicates_at_the_same_time_are_done_once(http: TestClient, module: str) -> None:
    body = samples(20)
    with ThreadPoolExecutor(16) as callers:
        answers = list(callers.map(lambda _: http.post(f"{module}/samples", json=body, headers=KEY).json(), range(16)))
    assert answers == [{"first": 0, "count": 20, "samples": 20}] * 16
    assert done(http.get(module))["samples"] == 20


def test_a_restart_forgets_no_key(store: Store) -> None:
    with open_lab(store) as lab, asking(lab) as http:
        http.post("/v1/modules", json=declaration())
        first = http.post("/v1/modules/map/samples", json=samples(2), headers=KEY)
    with open_lab(store) as lab, asking(lab) as http:
        again = http.post("/v1/modules/map/samples", json=samples(2), headers=KEY)
        assert (again.status_code, again.json()) == (201, first.json())
        assert done(http.get("/v1/modules/map"))["samples"] == 2


def test_a_key_counts_for_a_day(http: TestClient, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    done(http.post(f"{module}/samples", json=samples(1), headers=KEY), 201)
    now = time.time()
    monkeypatch.setattr(replies, "now", lambda: now + 23 * 3600.0)
    assert done(http.post(f"{module}/samples", json=samples(1), headers=KEY), 201)["first"] == 0
    monkeypatch.setattr(replies, "now", lambda: now + 25 * 3600.0)
    assert done(http.post(f"{module}/samples", json=samples(1), headers=KEY), 201)["first"] == 1
    assert done(http.post(f"{module}/samples", json=samples(1), headers=KEY), 201)["first"] == 1


def test_a_host_header_of_nonsense_does_not_matter(http: TestClient, module: str) -> None:
    for host in ("[", "a b", "::", "\x7f"):
        response = http.post(
            f"{module}/samples", json=samples(1), headers={"Host": host, "Idempotency-Key": f"k{host.encode().hex()}"}
        )
        assert response.status_code == 201, host


# --- robot, demonstrations, objects ---------------------------------------------------------------------------------


def test_runs_and_motions_start_once(lab: Lab, http: TestClient) -> None:
    lab.teach(lab.places)
    trained = ended(http, http.post("/v1/tasks/grasp/train", headers=KEY | {"Idempotency-Key": "train"}))
    again = http.post("/v1/tasks/grasp/train", headers={"Idempotency-Key": "train"})
    assert (again.status_code, again.json()["id"]) == (202, trained["id"])
    assert again.headers["location"] == f"/v1/jobs/{trained['id']}"

    run = ended(http, http.post("/v1/tasks/grasp/runs", json={"object": "blue cup"}, headers=KEY))
    assert run["state"] == "succeeded"
    commands = len(lab.robot.commands)
    again = http.post("/v1/tasks/grasp/runs", json={"object": "blue cup"}, headers=KEY)
    assert again.json()["id"] == run["id"]
    assert len(lab.robot.commands) == commands

    lease = {"Control-Lease": done(http.post("/v1/robot/lease", json={"holder": "alice"}), 201)["lease"]}
    move = lease | {"Idempotency-Key": "move"}
    lab.robot.hang, lab.robot.on_step = True, threading.Event()
    first = http.post("/v1/robot/actions/adjust_joints", json={"delta": [0.1] * 6}, headers=move)
    assert lab.robot.on_step.wait(5.0)
    # Not "busy": it is the same motion, which is under way.
    again = http.post("/v1/robot/actions/adjust_joints", json={"delta": [0.1] * 6}, headers=move)
    assert (again.status_code, again.json()["id"]) == (202, first.json()["id"])
    lab.robot.hang = False
    assert ended(http, first)["state"] == "succeeded"
    assert lab.robot.commands.count("adjust_joints") == 1 + sum(
        1 for name in lab.robot.commands[:commands] if name == "adjust_joints"
    )


def test_an_observation_is_made_once_also_when_its_answer_was_lost(lab: Lab, http: TestClient) -> None:
    http.post("/v1/objects/cup/backgrounds")
    http.post("/v1/objects/cup/examples")
    at = http.post("/v1/demonstrations", json={"task": "grasp", "object": "cup"}).headers["location"]
    first = done(http.post(f"{at}/observations", json={"subtask": "grasp", "goal": True}, headers=KEY), 201)
    lab.world.hidden.add("hand")  # nobody looks again
    again = done(http.post(f"{at}/observations", json={"subtask": "grasp", "goal": True}, headers=KEY), 201)
    assert again == first
    finish: dict[str, Any] = {"headers": {"Idempotency-Key": "finish"}}
    assert http.post(f"{at}/finish", **finish).json() == http.post(f"{at}/finish", **finish).json()
    assert done(http.get(at))["observations"] == 1


def test_a_picture_of_an_object_is_taken_once(lab: Lab, http: TestClient) -> None:
    first = done(http.post("/v1/objects/cup/backgrounds", headers=KEY), 201)
    lab.cameras.fail_with = Unavailable("nobody takes pictures again")
    again = done(http.post("/v1/objects/cup/backgrounds", headers=KEY), 201)
    assert again == first == {"name": "cup", "backgrounds": 1, "examples": 0, "learned": False}
    lab.cameras.fail_with = None
    http.post("/v1/objects/cup/examples")
    done(http.post("/v1/objects/cup/examples", headers={"Idempotency-Key": "other"}), 201)
    assert lab.sight.learned == {"cup": (2, 4)}


def test_pictures_asked_for_twice_at_the_same_time_are_learned_once(lab: Lab, http: TestClient) -> None:
    http.post("/v1/objects/cup/backgrounds")
    with ThreadPoolExecutor(8) as callers:
        answers = list(
            callers.map(lambda _: http.post("/v1/objects/cup/examples", headers=KEY).json()["examples"], range(8))
        )
    assert answers == [1] * 8
    assert lab.sight.learned == {"cup": (2, 2)}


def test_a_picture_that_cannot_be_written_down_is_not_learned(
    lab: Lab, http: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    http.post("/v1/objects/cup/backgrounds")
    with monkeypatch.context() as patched:
        patched.setattr(replies, "remember", lambda *_: 1 / 0)
        problem(http.post("/v1/objects/cup/examples", headers=KEY), 500, "internal")
        assert lab.sight.learned == {}
    http.post("/v1/objects/cup/examples")
    with monkeypatch.context() as patched:
        patched.setattr(replies, "remember", lambda *_: 1 / 0)
        problem(http.post("/v1/objects/cup/examples", headers=KEY), 500, "internal")
    assert lab.sight.learned == {"cup": (2, 2)}


def test_the_token_of_the_tests_is_none_of_the_store(lab: Lab) -> None:
    assert TOKEN not in {token.id for token in lab.access.tokens.all()}
