"""The REST routes: what they answer, to whom, and how they refuse."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
from pydantic import SecretStr

from handeye.rpc import errors
from handeye.server.settings import ServerSettings
from tests.server.conftest import TOKEN
from tests.server.rest import done, ended, problem

if TYPE_CHECKING:
    from starlette.testclient import TestClient

    from handeye.camera_bridge.driver import StereoPair
    from tests.server.conftest import Lab


def everything(http: TestClient) -> list[tuple[str, str]]:
    """Every (method, path) of the OpenAPI document, parameters filled in."""
    paths = http.get("/v1/openapi.json").json()["paths"]
    return [
        (method.upper(), path.replace("{number}", "0").replace("{camera}", "left").replace("{", "").replace("}", ""))
        for path, methods in paths.items()
        for method in methods
    ]


def test_nothing_but_health_answers_without_a_token(http: TestClient) -> None:
    listed = everything(http)
    assert ("GET", "/readyz") in listed
    assert len(listed) > 15
    del http.headers["Authorization"]
    for method, path in [*listed, ("GET", "/v1/openapi.json"), ("GET", "/nowhere")]:
        response = http.request(method, path)
        if path in ("/healthz", "/readyz"):
            assert response.status_code == 200
        else:
            assert "Authorization: Bearer" in problem(response, 401, "token_missing"), path
            assert response.headers["www-authenticate"] == "Bearer"


@pytest.mark.parametrize("header", ["Bearer wrong", f"Basic {TOKEN}", "Bearer", f"Bearer {TOKEN}x", "Bearer \u00e9"])
def test_a_wrong_token_is_refused_and_not_repeated(http: TestClient, header: str) -> None:
    response = http.get("/v1/robot", headers={b"Authorization": header.encode("latin-1")})
    assert response.status_code == 401
    assert TOKEN not in response.text


def test_the_scheme_of_the_token_is_case_insensitive(http: TestClient) -> None:
    assert http.get("/v1/robot", headers={"Authorization": f"bearer {TOKEN}"}).status_code == 200


def test_settings_hide_the_token_and_refuse_unknown_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HANDEYE_SERVER_TOKEN", TOKEN)
    monkeypatch.setenv("HANDEYE_SERVER_ACTING__MAX_LOOKS", "3")
    settings = ServerSettings()
    assert settings.token == SecretStr(TOKEN)
    assert settings.acting.max_looks == 3
    assert TOKEN not in repr(settings)
    with pytest.raises(ValueError, match="colour"):
        ServerSettings(colour="blue")  # type: ignore[call-arg]


def test_ready_only_with_everything(lab: Lab, http: TestClient) -> None:
    assert http.get("/readyz").json() == {"status": "ok"}
    lab.missing.append("nobody serves Camera on the bus")
    response = http.get("/readyz")
    assert "nobody serves Camera" in problem(response, 503, "not_ready")
    assert response.json()["missing"] == lab.missing
    assert http.get("/healthz").status_code == 200


def test_unknown_paths_and_methods_are_problems(http: TestClient) -> None:
    assert "/v1/nothing" in problem(http.get("/v1/nothing"), 404, "not_found")
    problem(http.delete("/v1/robot"), 405, "method_not_allowed")


@pytest.mark.parametrize(
    ("path", "body", "wrong"),
    [
        ("/v1/demonstrations", {"task": "grasp", "object": "cup", "colour": "blue"}, "body.colour"),
        ("/v1/demonstrations", {"task": "grasp"}, "body.object"),
        ("/v1/demonstrations", {"task": "../etc", "object": "cup"}, "body.task"),
        ("/v1/objects/cup/examples", {"not_older_than": -1.0}, "body.not_older_than"),
        ("/v1/objects/cup/examples", {"not_older_than": "nan"}, "body.not_older_than"),
        ("/v1/tasks/grasp/train", {"pairs": "some"}, "body.pairs"),
        ("/v1/tasks/grasp/runs", {"object": "cup", "one_look": "perhaps"}, "body.one_look"),
    ],
)
def test_wrong_bodies_name_the_field(http: TestClient, path: str, body: dict[str, object], wrong: str) -> None:
    response = http.post(path, json=body)
    assert wrong in problem(response, 422, "invalid_argument")
    assert wrong in [field["location"] for field in response.json()["fields"]]


@pytest.mark.parametrize(
    ("error", "status", "code"),
    [
        (errors.Unavailable, 503, "unavailable"),
        (errors.DeadlineExceeded, 504, "deadline_exceeded"),
        (errors.InvalidArgument, 422, "invalid_argument"),
        (errors.OutOfLimits, 422, "out_of_limits"),
        (errors.Unreachable, 422, "unreachable"),
        (errors.Busy, 409, "busy"),
        (errors.Stopped, 409, "stopped"),
        (errors.Slipping, 409, "slipping"),
        (errors.Unauthorised, 502, "unauthorised"),
        (errors.Internal, 502, "bridge_failed"),
    ],
)
def test_errors_of_the_bridges_have_their_status(
    lab: Lab, http: TestClient, error: type[errors.RpcError], status: int, code: str
) -> None:
    lab.cameras.fail_with = error("the bridge says why")
    assert problem(http.get("/v1/cameras/left/frame"), status, code) == "the bridge says why"


def test_what_nobody_foresaw_is_a_500_without_details(lab: Lab, http: TestClient) -> None:
    lab.cameras.grab_stereo = lambda *_: 1 / 0  # type: ignore[method-assign, assignment]
    assert "division" not in problem(http.get("/v1/cameras/right/frame"), 500, "internal")


def test_robot_state_stop_and_reset(lab: Lab, http: TestClient) -> None:
    state = http.get("/v1/robot").json()
    assert (state["stopped"], state["still_since"], len(state["joints"])) == (False, 0.0, 6)
    assert state["point"] == pytest.approx(lab.world.point)
    assert http.post("/v1/robot/stop", json={"reason": "a test"}).json()["stopped"]
    assert lab.robot.stopped == "a test"
    assert not http.post("/v1/robot/reset").json()["stopped"]
    lab.world.moving = True
    assert http.get("/v1/robot").json()["still_since"] is None


@pytest.mark.parametrize(
    ("method", "path", "body"),
    [("GET", "/v1/cameras/left/frame", None), ("POST", "/v1/objects/cup/backgrounds", {})],
)
def test_stop_and_cancel_do_not_queue_behind_requests_that_wait_for_pictures(
    lab: Lab, http: TestClient, method: str, path: str, body: dict[str, object] | None
) -> None:
    lab.teach(lab.places)
    lab.train()
    lab.cameras.gate = threading.Event()
    with ThreadPoolExecutor(61) as callers:
        try:
            pending = [callers.submit(http.request, method, path, json=body) for _ in range(60)]
            assert lab.cameras.waiting.wait(10.0)
            run = callers.submit(http.post, "/v1/tasks/grasp/runs", json={"object": "blue cup"}).result(5.0)
            cancel = callers.submit(http.post, f"{run.headers['location']}/cancel").result(5.0)
            assert cancel.status_code == 202
            stop = callers.submit(http.post, "/v1/robot/stop", json={"reason": "a test"}).result(5.0)
            assert stop.json()["stopped"]
            assert not any(answer.done() for answer in pending)
        finally:
            lab.cameras.gate.set()
        assert all(answer.result(10.0).status_code < 500 for answer in pending)


@pytest.mark.parametrize("camera", ["left", "right", "observer"])
def test_frames_are_jpeg_and_tell_their_time(http: TestClient, camera: str) -> None:
    response = http.get(f"/v1/cameras/{camera}/frame")
    assert response.headers["content-type"] == "image/jpeg"
    assert float(response.headers["world-time"]) == pytest.approx(0.95)
    image = cv2.imdecode(np.frombuffer(response.content, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape == (48, 64, 3)
    problem(http.get(f"/v1/cameras/{camera}/frame", params={"not_older_than": 9.0}), 504, "deadline_exceeded")


def test_there_are_three_cameras(http: TestClient) -> None:
    problem(http.get("/v1/cameras/fourth/frame"), 422, "invalid_argument")


def test_an_object_is_learned_from_both_kinds_of_pictures(lab: Lab, http: TestClient) -> None:
    assert http.get("/v1/objects").json() == {"objects": []}
    response = http.post("/v1/objects/blue cup/backgrounds")
    assert response.status_code == 201
    assert response.json() == {"name": "blue cup", "backgrounds": 1, "examples": 0, "learned": False}
    assert lab.sight.learned == {}
    assert http.post("/v1/objects/blue cup/examples", json={"not_older_than": 0.5}).json()["learned"]
    assert lab.sight.learned == {"blue cup": (2, 2)}
    assert http.get("/v1/objects").json()["objects"][0]["name"] == "blue cup"


def test_a_demonstration_from_begin_to_finish(lab: Lab, http: TestClient) -> None:
    wanted = {"task": "grasp", "object": "blue cup"}
    assert "not learned" in problem(http.post("/v1/demonstrations", json=wanted), 404, "not_found")
    http.post("/v1/objects/blue cup/backgrounds")
    http.post("/v1/objects/blue cup/examples")
    begun = http.post("/v1/demonstrations", json=wanted)
    assert (begun.status_code, begun.headers["location"]) == (201, "/v1/demonstrations/grasp-1")
    at = begun.headers["location"]

    assert "empty" in problem(http.post(f"{at}/finish"), 409, "incomplete")
    early = http.post(f"{at}/actions", json={"subtask": "grasp", "action": "close_gripper"})
    assert "no observation of subtask 'grasp'" in problem(early, 409, "conflict")

    seen = http.post(f"{at}/observations", json={"subtask": "grasp", "key": True})
    assert seen.status_code == 201
    assert seen.json()["hand"] == pytest.approx([290.0, 260.0, 174.0])
    assert seen.json()["joints"] == pytest.approx([0.5, -0.5, 0.4, 0.0, 0.3, 0.0])
    assert "no goal for 'grasp'" in problem(http.post(f"{at}/finish"), 409, "incomplete")

    goal = {"subtask": "grasp", "goal": True}
    assert http.post(f"{at}/observations", json=goal).json()["number"] == 1
    assert "already has its goal" in problem(http.post(f"{at}/observations", json=goal), 409, "conflict")
    action = {"subtask": "grasp", "action": "close_gripper"}
    assert http.post(f"{at}/actions", json=action).status_code == 201
    assert "one action" in problem(http.post(f"{at}/actions", json=action), 409, "conflict")

    finished = http.post(f"{at}/finish").json()
    assert datetime.fromisoformat(finished.pop("created")).tzinfo is not None
    assert finished == {
        "id": "grasp-1",
        "outcome": None,
        "task": "grasp",
        "object": "blue cup",
        "state": "finished",
        "observations": 2,
        "subtasks": [{"name": "grasp", "action": "close_gripper", "object": None, "way": []}],
    }
    assert "is finished" in problem(http.post(f"{at}/observations", json=goal), 409, "conflict")
    assert len(http.get("/v1/demonstrations").json()["demonstrations"]) == 1
    problem(http.get("/v1/demonstrations/grasp-2"), 404, "not_found")


def test_observations_need_a_resting_arm_and_a_visible_hand(lab: Lab, http: TestClient) -> None:
    http.post("/v1/objects/cup/backgrounds")
    http.post("/v1/objects/cup/examples")
    at = http.post("/v1/demonstrations", json={"task": "grasp", "object": "cup"}).headers["location"]
    wanted = {"subtask": "grasp"}
    lab.world.moving = True
    assert "moving" in problem(http.post(f"{at}/observations", json=wanted), 409, "busy")
    lab.world.moving = False
    lab.world.hidden.add("hand")
    assert "hand" in problem(http.post(f"{at}/observations", json=wanted), 422, "not_seen")
    lab.world.hidden.clear()
    lab.world.still_since = lab.world.time  # no picture shows it at rest yet
    problem(http.post(f"{at}/observations", json=wanted), 504, "deadline_exceeded")


def test_a_task_over_rest(lab: Lab, http: TestClient) -> None:
    untaught = ended(http, http.post("/v1/tasks/grasp/train"))
    assert (untaught["state"], untaught["error"]["code"]) == ("failed", "not_found")
    lab.teach(lab.places)
    asked = {"pairs": "all", "approximator": "local_linear"}
    trained = ended(http, http.post("/v1/tasks/grasp/train", json=asked))
    assert (trained["kind"], trained["subject"], trained["state"]) == ("train", "grasp", "succeeded")
    assert trained["result"]["pairs"] == 10 * len(lab.places)
    assert [s["name"] for s in trained["result"]["subtasks"]] == ["grasp", "lift"]
    problem(http.post("/v1/tasks/grasp/runs", json={"object": "green mug"}), 404, "not_found")

    accepted = http.post("/v1/tasks/grasp/runs", json={"object": "blue cup"})
    assert accepted.status_code == 202
    at = accepted.headers["location"]
    stream = http.get(f"{at}/events")  # ends with the job
    assert stream.headers["content-type"].startswith("text/event-stream")
    kinds = [line.removeprefix("event: ") for line in stream.text.splitlines() if line.startswith("event: ")]
    assert kinds[:2] == ["state", "subtask"]
    assert kinds[-1] == "state"
    assert "look" in kinds

    job = http.get(at).json()
    assert job["state"] == "succeeded"
    looks = [look for subtask in job["result"]["subtasks"] for look in subtask["looks"]]
    assert [look["number"] for look in looks] == list(range(len(looks)))
    picture = http.get(looks[-1]["picture"])
    assert picture.headers["content-type"] == "image/jpeg"
    assert "no picture of look" in problem(http.get(f"{at}/looks/{len(looks)}.jpg"), 404, "not_found")
    last = http.get(f"{at}/events", headers={"Last-Event-ID": str(len(kinds) - 1)})
    assert last.text.count("event: ") == 1
    assert http.post(f"{at}/cancel").json()["state"] == "succeeded"
    problem(http.get("/v1/jobs/none/events"), 404, "not_found")


def test_the_openapi_document_names_the_problems(http: TestClient) -> None:
    document = http.get("/v1/openapi.json").json()
    assert "Problem" in document["components"]["schemas"]
    assert document["components"]["securitySchemes"]["token"] == {"type": "http", "scheme": "bearer"}
    for path, methods in document["paths"].items():
        if path.startswith("/v1"):
            for operation in methods.values():
                assert "application/problem+json" in operation["responses"]["422"]["content"], path


def test_a_job_that_was_stopped_does_not_go_on_when_the_stop_is_cleared(
    lab: Lab, http: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    lab.teach(lab.places)
    lab.train()
    grab, waiting, come = lab.cameras.grab_stereo, threading.Event(), threading.Event()

    def late(*asked: Any) -> StereoPair:
        waiting.set()
        assert come.wait(10.0)
        return grab(*asked)

    monkeypatch.setattr(lab.cameras, "grab_stereo", late)
    run = http.post("/v1/tasks/grasp/runs", json={"object": "blue cup"}).headers["location"]
    assert waiting.wait(10.0)
    http.post("/v1/robot/stop", json={"reason": "a test"})
    assert run.rsplit("/", 1)[1] in problem(http.post("/v1/robot/reset"), 409, "busy")
    come.set()
    http.get(f"{run}/events")  # ends with the job
    done(http.post("/v1/robot/reset"))
    assert done(http.get(run))["state"] == "cancelled"
    assert "adjust_joints" not in lab.robot.commands
