"""Snapshots: a module is as it was, also after removal, after training anew and after a restart."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqlalchemy import func, select

from handeye.server.store import tables
from tests.server.conftest import asking, open_lab
from tests.server.rest import NPZ, declaration, done, ended, packed, problem, samples, taught

if TYPE_CHECKING:
    from starlette.testclient import TestClient

    from handeye.server.store import Store

QUERIES = {"inputs": taught(9, seed=77)[0].tolist(), "neighbours": 6}


def told(http: TestClient) -> bytes:
    """What the module answers, to the last bit; its support calibrated freshly."""
    ended(http, http.post("/v1/modules/map/train"))
    response = http.post("/v1/modules/map/query", json=QUERIES)
    assert response.status_code == 200, response.text
    return response.content


def stored_samples(store: Store) -> int:
    with store.read() as connection:
        return int(connection.execute(select(func.count()).select_from(tables.samples)).scalar_one())


def prepare(http: TestClient) -> bytes:
    """A module of 40 samples with a snapshot 'first'; what it answers."""
    http.post("/v1/modules", json=declaration())
    inputs, outputs = taught(40)
    body = packed(inputs=inputs, outputs=outputs, demonstrations=["a-1", "a-2", "a-3", ""] * 10)
    done(http.post("/v1/modules/map/samples", content=body, headers=NPZ), 201)
    before = told(http)
    taken = done(http.post("/v1/modules/map/snapshots", json={"name": "first"}), 201)
    assert (taken["name"], taken["samples"]) == ("first", 40)
    return before


def roll_back(http: TestClient, name: str = "first") -> dict[str, object]:
    info: dict[str, object] = done(http.post(f"/v1/modules/map/snapshots/{name}/rollback"))
    return info


def test_a_snapshot_brings_back_what_was_removed_and_forgets_what_came(http: TestClient) -> None:
    before = prepare(http)
    done(http.delete("/v1/modules/map/samples", params={"demonstration": "a-2"}))
    done(http.delete("/v1/modules/map/samples", params={"number": [0, 3]}))
    http.post("/v1/modules/map/samples", json=samples(15, seed=5))
    assert told(http) != before
    info = roll_back(http)
    assert (info["samples"], info["demonstrations"]) == (40, 3)
    direct = http.post("/v1/modules/map/query", json=QUERIES).content
    assert direct == before
    assert told(http) == before
    # Numbers are never used twice: the next one is beyond all that ever were.
    assert done(http.post("/v1/modules/map/samples", json=samples(1)), 201)["first"] == 55


def test_a_snapshot_brings_back_the_settings(http: TestClient) -> None:
    before = prepare(http)
    ended(http, http.post("/v1/modules/map/train", json={"approximator": {"method": "nearest"}}))
    assert told(http) != before
    roll_back(http)
    assert http.post("/v1/modules/map/query", json=QUERIES).content == before
    assert done(http.get("/v1/modules/map"))["declaration"]["approximator"]["method"] == "local_linear"


def test_a_rollback_can_be_undone_by_another(http: TestClient) -> None:
    first = prepare(http)
    http.delete("/v1/modules/map/samples", params={"number": [1, 2]})
    http.post("/v1/modules/map/samples", json=samples(5, seed=6))
    ended(http, http.post("/v1/modules/map/train", json={"approximator": {"method": "kndb"}}))
    second = told(http)
    done(http.post("/v1/modules/map/snapshots", json={"name": "second"}), 201)
    for _ in range(2):
        roll_back(http, "first")
        assert http.post("/v1/modules/map/query", json=QUERIES).content == first
        roll_back(http, "second")
        assert http.post("/v1/modules/map/query", json=QUERIES).content == second
    listed = done(http.get("/v1/modules/map/snapshots"))["snapshots"]
    assert [(each["name"], each["samples"]) for each in listed] == [("first", 40), ("second", 43)]


def test_a_rolled_back_module_is_the_same_after_a_restart(store: Store) -> None:
    with open_lab(store) as lab, asking(lab) as http:
        before = prepare(http)
        http.delete("/v1/modules/map/samples", params={"demonstration": "a-1"})
    with open_lab(store) as lab, asking(lab) as http:
        assert told(http) != before
        roll_back(http)
        assert http.post("/v1/modules/map/query", json=QUERIES).content == before
    with open_lab(store) as lab, asking(lab) as http:
        assert http.post("/v1/modules/map/query", json=QUERIES).content == before


def test_what_is_removed_is_kept_as_long_as_a_snapshot_has_it(store: Store) -> None:
    with open_lab(store) as lab, asking(lab) as http:
        prepare(http)
        http.post("/v1/modules/map/snapshots", json={"name": "second"})
        http.delete("/v1/modules/map/samples", params={"demonstration": "a-1"})
        http.post("/v1/modules/map/samples", json=samples(2, demonstration="b-1"))
        http.delete("/v1/modules/map/samples", params={"demonstration": "b-1"})  # in no snapshot
        assert stored_samples(store) == 40
        assert http.delete("/v1/modules/map/snapshots/first").status_code == 204
        assert stored_samples(store) == 40
        assert http.delete("/v1/modules/map/snapshots/second").status_code == 204
        assert stored_samples(store) == 30
        http.delete("/v1/modules/map")
        assert stored_samples(store) == 0


def test_an_empty_module_has_a_snapshot_too(http: TestClient) -> None:
    http.post("/v1/modules", json=declaration())
    done(http.post("/v1/modules/map/snapshots", json={"name": "nothing"}), 201)
    http.post("/v1/modules/map/samples", json=samples(3))
    assert roll_back(http, "nothing")["samples"] == 0
    problem(http.post("/v1/modules/map/query", json=QUERIES), 409, "not_taught")


def test_snapshots_that_are_not_there_or_are_there_already(http: TestClient) -> None:
    prepare(http)
    assert "'first'" in problem(http.post("/v1/modules/map/snapshots", json={"name": "first"}), 409, "conflict")
    assert "'other'" in problem(http.post("/v1/modules/map/snapshots/other/rollback"), 404, "not_found")
    assert "'other'" in problem(http.delete("/v1/modules/map/snapshots/other"), 404, "not_found")
    for name in ("", "a/b", "x" * 64):
        problem(http.post("/v1/modules/map/snapshots", json={"name": name}), 422, "invalid_argument")
    for method, path in (("GET", ""), ("POST", ""), ("POST", "/first/rollback"), ("DELETE", "/first")):
        body = {"name": "first"} if (method, path) == ("POST", "") else None
        response = http.request(method, f"/v1/modules/nobody/snapshots{path}", json=body)
        problem(response, 404, "not_found")


def test_a_snapshot_is_taken_once(http: TestClient) -> None:
    prepare(http)
    key = {"Idempotency-Key": "k"}
    first = http.post("/v1/modules/map/snapshots", json={"name": "second"}, headers=key)
    again = http.post("/v1/modules/map/snapshots", json={"name": "second"}, headers=key)
    assert (again.status_code, again.content) == (201, first.content)
