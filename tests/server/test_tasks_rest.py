"""Trained tasks over REST, and what becomes of them when what they were taught changes."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from handeye.modules.spaces import ImagePair, ImagePoint
from tests.server.conftest import asking, open_lab
from tests.server.rest import declaration, done, ended, problem

if TYPE_CHECKING:
    from starlette.testclient import TestClient

    from handeye.server.store import Store
    from tests.server.conftest import Lab


@pytest.fixture
def trained(lab: Lab) -> Lab:
    lab.teach(lab.places[:6])
    lab.train()
    return lab


def waiting_run(lab: Lab, http: TestClient) -> Any:
    """A run that waits for its first picture; `lab.cameras.gate` lets it go on."""
    lab.cameras.gate = threading.Event()
    lab.cameras.waiting.clear()
    accepted = http.post("/v1/tasks/grasp/runs", json={"object": "blue cup"})
    assert accepted.status_code == 202
    assert lab.cameras.waiting.wait(5.0)
    return accepted


def shown_in(job: dict[str, Any]) -> set[str]:
    """The demonstrations that a run's answers came from."""
    looks = [look for subtask in job["result"]["subtasks"] for look in subtask["looks"]]
    return {neighbour["demonstration"] for look in looks for neighbour in look["neighbours"]}


def test_tasks_are_listed_read_and_deleted_with_their_module(trained: Lab, http: TestClient) -> None:
    info = done(http.get("/v1/tasks/grasp"))
    assert info == {
        "name": "grasp",
        "module": "IJS.grasp",
        "subtasks": [
            {"name": "grasp", "action": "close_gripper", "object": None, "way": []},
            {"name": "lift", "action": None, "object": None, "way": []},
        ],
        "demonstrations": [f"grasp-{n}" for n in range(1, 7)],
    }
    assert done(http.get("/v1/tasks")) == {"tasks": [info]}
    module = done(http.get("/v1/modules/IJS.grasp"))
    assert (module["samples"], module["demonstrations"]) == (60, 6)
    assert "DELETE /v1/tasks/grasp" in problem(http.delete("/v1/modules/IJS.grasp"), 409, "conflict")
    assert http.delete("/v1/tasks/grasp").status_code == 204
    assert done(http.get("/v1/tasks")) == {"tasks": []}
    problem(http.get("/v1/modules/IJS.grasp"), 404, "not_found")
    for response in (
        http.get("/v1/tasks/grasp"),
        http.delete("/v1/tasks/grasp"),
        http.post("/v1/tasks/grasp/runs", json={"object": "blue cup"}),
    ):
        assert "trained: none yet" in problem(response, 404, "not_found")
    # Its demonstrations stay.
    assert ended(http, http.post("/v1/tasks/grasp/train"))["state"] == "succeeded"


def test_a_task_does_not_take_over_somebodys_module(lab: Lab, http: TestClient) -> None:
    lab.teach(lab.places[:3])
    http.post("/v1/modules", json=declaration("IJS.grasp"))
    job = ended(http, http.post("/v1/tasks/grasp/train"))
    assert (job["state"], job["error"]["code"]) == ("failed", "conflict")
    assert "DELETE /v1/modules/IJS.grasp" in job["error"]["message"]
    assert done(http.get("/v1/modules/IJS.grasp"))["declaration"]["inputs"][0]["name"] == "x"


@pytest.mark.parametrize("approximator", ["nearest", {"method": "kndb", "neighbours": 3}, None])
def test_a_task_is_trained_with_the_settings_asked_for(lab: Lab, http: TestClient, approximator: Any) -> None:
    lab.teach(lab.places[:3])
    job = ended(http, http.post("/v1/tasks/grasp/train", json={"pairs": "key", "approximator": approximator}))
    assert job["state"] == "succeeded"
    assert job["result"]["pairs"] == 6
    settings = done(http.get("/v1/modules/IJS.grasp"))["declaration"]["approximator"]
    assert settings == job["result"]["approximator"]
    assert settings["method"] == {"nearest": "nearest", None: "local_quadratic"}.get(
        approximator if not isinstance(approximator, dict) else "", "kndb"
    )


def test_failures_are_not_trained_from(lab: Lab, http: TestClient) -> None:
    lab.teach(lab.places[:4])
    assert done(http.patch("/v1/demonstrations/grasp-2", json={"outcome": "failure"}))["outcome"] == "failure"
    job = ended(http, http.post("/v1/tasks/grasp/train"))
    assert job["result"]["demonstrations"] == ["grasp-1", "grasp-3", "grasp-4"]
    done(http.patch("/v1/demonstrations/grasp-2", json={"outcome": "success"}))
    job = ended(http, http.post("/v1/tasks/grasp/train"))
    assert job["result"]["demonstrations"] == ["grasp-1", "grasp-2", "grasp-3", "grasp-4"]


def test_a_demonstration_that_is_deleted_is_asked_no_more(trained: Lab, http: TestClient) -> None:
    assert http.delete("/v1/demonstrations/grasp-1").status_code == 204
    assert done(http.get("/v1/modules/IJS.grasp"))["demonstrations"] == 5
    assert done(http.get("/v1/tasks/grasp"))["demonstrations"] == [f"grasp-{n}" for n in range(2, 7)]
    state = trained.world.joints
    query = np.concatenate([[0.0, 0.0, 0.0, 0.0], state]).tolist()
    (answer,) = done(http.post("/v1/modules/IJS.grasp/query", json={"inputs": [query], "neighbours": 1000}))["answers"]
    shown = {neighbour["demonstration"] for neighbour in answer["neighbours"]}
    assert shown == {f"grasp-{n}" for n in range(2, 7)}


def test_a_run_under_way_asks_it_no_more_either_also_after_training_anew(trained: Lab, http: TestClient) -> None:
    """The next answer of a run goes by the module as it is then, whatever it was when the run began."""
    lab = trained
    lab.world.cup = np.array([230.0, 310.0, 150.0])
    accepted = waiting_run(lab, http)
    assert ended(http, http.post("/v1/modules/IJS.grasp/train"))["state"] == "succeeded"
    assert http.delete("/v1/demonstrations/grasp-3").status_code == 204
    assert lab.cameras.gate is not None
    lab.cameras.gate.set()
    job = ended(http, accepted)
    assert "grasp-3" not in shown_in(job)
    assert shown_in(job) >= {"grasp-1", "grasp-2"}


def test_a_run_whose_task_goes_ends_with_a_sentence(trained: Lab, http: TestClient) -> None:
    lab = trained
    accepted = waiting_run(lab, http)
    http.delete("/v1/tasks/grasp")
    assert lab.cameras.gate is not None
    lab.cameras.gate.set()
    job = ended(http, accepted)
    assert (job["state"], job["error"]["code"]) == ("failed", "not_found")
    assert lab.robot.stopped


def test_a_run_whose_task_is_trained_with_other_subtasks_ends_with_a_sentence(trained: Lab, http: TestClient) -> None:
    lab = trained
    accepted = waiting_run(lab, http)
    demonstrations = lab.coordinator.demonstrations
    for number in range(1, 7):
        lab.coordinator.untrain(f"grasp-{number}")
    shown = demonstrations.begin("grasp", "blue cup").id
    place = ImagePoint(240.0, 320.0, 150.0)
    for subtask in ("wave", "grasp", "lift"):
        for goal in (False, True):
            found = ImagePair(object=place, hand=place)
            demonstrations.observe(shown, subtask, found, lab.world.joints, 1.0, goal=goal, key=not goal)
    demonstrations.finish(shown)
    lab.train()
    assert lab.cameras.gate is not None
    lab.cameras.gate.set()
    job = ended(http, accepted)
    assert (job["state"], job["error"]["code"]) == ("failed", "conflict")
    assert "other subtasks" in job["error"]["message"]


def test_a_run_of_a_task_that_forgot_everything_says_so(trained: Lab, http: TestClient) -> None:
    for number in range(1, 7):
        http.delete(f"/v1/demonstrations/grasp-{number}")
    assert done(http.get("/v1/tasks/grasp"))["demonstrations"] == []
    job = ended(http, http.post("/v1/tasks/grasp/runs", json={"object": "blue cup"}))
    assert (job["state"], job["error"]["code"]) == ("failed", "not_taught")
    assert "not been taught" in job["error"]["message"]


def test_a_demonstration_deleted_while_the_task_is_trained_teaches_nothing(lab: Lab, http: TestClient) -> None:
    lab.teach(lab.places[:4])
    trainable = lab.coordinator.demonstrations.trainable
    deleting: list[threading.Thread] = []

    def disturbed(task: str) -> Any:
        found = trainable(task)
        deleting.append(threading.Thread(target=http.delete, args=("/v1/demonstrations/grasp-2",)))
        deleting[0].start()
        deleting[0].join(0.3)  # it waits for the training, or is done before
        return found

    lab.coordinator.demonstrations.trainable = disturbed  # type: ignore[method-assign]
    job = ended(http, http.post("/v1/tasks/grasp/train"))
    deleting[0].join(5.0)
    assert job["state"] == "succeeded"
    assert done(http.get("/v1/modules/IJS.grasp"))["demonstrations"] == 3


def test_tasks_are_there_after_a_restart(store: Store) -> None:
    with open_lab(store) as lab, asking(lab) as http:
        lab.teach(lab.places[:5])
        lab.train()
        before = done(http.get("/v1/tasks"))
    with open_lab(store) as lab, asking(lab) as http:
        assert done(http.get("/v1/tasks")) == before
        assert lab.sight.learned == {"blue cup": (2, 2)}
        lab.world.cup = np.array([210.0, 300.0, 150.0])
        assert ended(http, http.post("/v1/tasks/grasp/runs", json={"object": "blue cup"}))["state"] == "succeeded"


def test_tasks_can_be_listed_before_their_modules_are_built(store: Store) -> None:
    with open_lab(store) as lab, asking(lab) as http:
        lab.teach(lab.places[:3])
        lab.train()
        lab.coordinator.modules._loaded.clear()
        lab.coordinator.modules._live.clear()
        assert len(done(http.get("/v1/tasks"))["tasks"]) == 1
        for response in (
            http.post("/v1/tasks/grasp/runs", json={"object": "blue cup"}),
            http.get("/v1/modules/IJS.grasp/statistics"),
            http.delete("/v1/demonstrations/grasp-1"),
        ):
            assert "being built" in problem(response, 503, "not_ready")
            assert response.headers["retry-after"] == "1"
        assert len(done(http.get("/v1/demonstrations"))["demonstrations"]) == 3
