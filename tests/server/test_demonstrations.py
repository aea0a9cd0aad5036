"""Demonstrations over REST: pages, what people say of them, and what becomes of their samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.server.conftest import asking, open_lab
from tests.server.rest import declaration, done, problem, samples

if TYPE_CHECKING:
    from starlette.testclient import TestClient

    from handeye.server.store import Store
    from tests.server.conftest import Lab


def test_demonstrations_come_in_pages_in_the_order_they_were_begun(lab: Lab, http: TestClient) -> None:
    for task in ("b", "a", "b", "größer", "a"):
        lab.coordinator.demonstrations.begin(task, "cup")
    seen, more = [], {"limit": "2"}
    for _ in range(3):
        page = done(http.get("/v1/demonstrations", params=more))
        seen += [each["id"] for each in page["demonstrations"]]
        more["cursor"] = page["next"]
    assert (seen, page["next"]) == (["b-1", "a-1", "b-2", "größer-1", "a-2"], None)


def test_a_number_is_not_given_twice(lab: Lab, http: TestClient) -> None:
    for _ in range(3):
        lab.coordinator.demonstrations.begin("grasp", "cup")
    http.delete("/v1/demonstrations/grasp-3")
    assert lab.coordinator.demonstrations.begin("grasp", "cup").id == "grasp-4"


def test_what_was_observed_can_be_read(lab: Lab, http: TestClient) -> None:
    lab.teach(lab.places[:1])
    observed = done(http.get("/v1/demonstrations/grasp-1/observations"))["observations"]
    assert [each["number"] for each in observed] == list(range(10))
    assert [each["subtask"] for each in observed] == ["grasp"] * 5 + ["lift"] * 5
    assert [each["goal"] for each in observed] == ([False] * 4 + [True]) * 2
    assert [each["key"] for each in observed] == ([True] + [False] * 4) * 2
    info = done(http.get("/v1/demonstrations/grasp-1"))
    assert (info["state"], info["observations"], info["outcome"]) == ("finished", 10, None)
    problem(http.get("/v1/demonstrations/grasp-2/observations"), 404, "not_found")


def test_what_people_say_can_be_said_again_and_taken_back(lab: Lab, http: TestClient) -> None:
    lab.teach(lab.places[:1])
    for outcome in ("failure", "success", None):
        assert done(http.patch("/v1/demonstrations/grasp-1", json={"outcome": outcome}))["outcome"] == outcome
        assert done(http.get("/v1/demonstrations/grasp-1"))["outcome"] == outcome
    for body in ({"outcome": "perhaps"}, {}, {"outcome": "success", "state": "recording"}):
        problem(http.patch("/v1/demonstrations/grasp-1", json=body), 422, "invalid_argument")
    problem(http.patch("/v1/demonstrations/grasp-2", json={"outcome": "success"}), 404, "not_found")


def test_a_deleted_demonstrations_samples_leave_every_module(lab: Lab, http: TestClient) -> None:
    lab.teach(lab.places[:3])
    lab.train()
    http.post("/v1/modules", json=declaration())
    http.post("/v1/modules/map/samples", json=samples(4, demonstration="grasp-2"))
    http.post("/v1/modules/map/samples", json=samples(3, seed=1, demonstration="other"))
    assert http.delete("/v1/demonstrations/grasp-2").status_code == 204
    for module, left in (("IJS.grasp", 20), ("map", 3)):
        assert done(http.get(f"/v1/modules/{module}"))["samples"] == left
        assert lab.coordinator.modules.live(module).samples == left
    problem(http.delete("/v1/demonstrations/grasp-2"), 404, "not_found")
    problem(http.get("/v1/demonstrations/grasp-2"), 404, "not_found")
    # What a snapshot remembers comes back only when somebody rolls back to it.
    assert [each["id"] for each in done(http.get("/v1/demonstrations"))["demonstrations"]] == ["grasp-1", "grasp-3"]


def test_demonstrations_survive_a_restart_and_can_be_gone_on_with(store: Store) -> None:
    with open_lab(store) as lab, asking(lab) as http:
        http.post("/v1/objects/cup/backgrounds")
        http.post("/v1/objects/cup/examples")
        at = http.post("/v1/demonstrations", json={"task": "grasp", "object": "cup"}).headers["location"]
        first = done(http.post(f"{at}/observations", json={"subtask": "grasp"}), 201)
    with open_lab(store) as lab, asking(lab) as http:
        assert done(http.get(f"{at}/observations"))["observations"] == [first]
        done(http.post(f"{at}/observations", json={"subtask": "grasp", "goal": True}), 201)
        assert done(http.post(f"{at}/finish"))["state"] == "finished"


def test_the_longest_name_of_a_task_can_be_taught_and_untaught(lab: Lab, http: TestClient) -> None:
    task = "x" * 63
    lab.teach(lab.places[:2], task)
    lab.train(task)
    shown = f"{task}-2"
    assert done(http.delete(f"/v1/modules/IJS.{task}/samples", params={"demonstration": shown})) == {"removed": 10}
    assert done(http.get(f"/v1/tasks/{task}"))["demonstrations"] == [f"{task}-1"]


def test_an_object_that_is_deleted_is_known_no_more(lab: Lab, http: TestClient) -> None:
    http.post("/v1/objects/cup/backgrounds")
    http.post("/v1/objects/cup/examples")
    assert http.delete("/v1/objects/cup").status_code == 204
    assert lab.sight.learned == {}
    problem(http.delete("/v1/objects/cup"), 404, "not_found")
    problem(http.post("/v1/demonstrations", json={"task": "grasp", "object": "cup"}), 404, "not_found")


def test_an_object_has_twenty_pairs_of_a_kind_at_most(lab: Lab, http: TestClient) -> None:
    for _ in range(20):
        done(http.post("/v1/objects/cup/backgrounds"), 201)
    assert "20 backgrounds" in problem(http.post("/v1/objects/cup/backgrounds"), 409, "conflict")
    assert done(http.get("/v1/objects"))["objects"][0]["backgrounds"] == 20


def test_an_object_that_is_not_recognised_can_be_marked_by_a_person(lab: Lab, http: TestClient) -> None:
    http.post("/v1/objects/cup/backgrounds")
    http.post("/v1/objects/cup/examples")
    at = http.post("/v1/demonstrations", json={"task": "grasp", "object": "cup"}).headers["location"]
    lab.world.hidden.add("object")
    look = {"subtask": "grasp", "goal": True}
    assert "object 'cup'" in problem(http.post(f"{at}/observations", json=look), 422, "not_seen")
    seen = done(http.post(f"{at}/observations", json={**look, "object_at": [231.5, 340.0, 151.25]}), 201)
    assert seen["object"] == [231.5, 340.0, 151.25]
    assert seen["hand"] == pytest.approx(lab.world.hand, abs=0.051)
    lab.world.hidden.add("hand")
    unseen = {"subtask": "grasp", "object_at": [231.5, 340.0, 151.25]}
    assert "hand" in problem(http.post(f"{at}/observations", json=unseen), 422, "not_seen")
    wrong = http.post(f"{at}/observations", json={"subtask": "grasp", "object_at": [231.5, 340.0]})
    problem(wrong, 422, "invalid_argument")
