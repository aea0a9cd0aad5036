"""Modules over REST: declare, list, look inside, train anew, carry elsewhere, delete."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from handeye.modules.answers import TaughtSamples
from handeye.modules.declaration import ModuleDeclaration
from handeye.modules.module import Module
from handeye.server.store import Store
from tests.server.conftest import asking, open_lab
from tests.server.rest import NPZ, declaration, done, ended, packed, problem, samples, taught, unpacked

if TYPE_CHECKING:
    from pathlib import Path

    from starlette.testclient import TestClient

    from tests.server.conftest import Lab


def changed(**changes: Any) -> dict[str, Any]:
    return declaration() | changes


def told(http: TestClient, module: str = "map", count: int = 7) -> bytes:
    """What a module answers to some queries, to the last bit."""
    queries = taught(count, seed=99)[0]
    response = http.post(f"/v1/modules/{module}/query", json={"inputs": queries.tolist(), "neighbours": 5})
    assert response.status_code == 200, response.text
    return response.content


def test_a_module_is_declared_listed_read_and_deleted(http: TestClient) -> None:
    made = http.post("/v1/modules", json=declaration("map 1"))
    assert made.headers["location"] == "/v1/modules/map%201"
    info = done(made, 201)
    assert datetime.fromisoformat(info["created"]).tzinfo is not None
    assert (info["name"], info["samples"], info["demonstrations"]) == ("map 1", 0, 0)
    assert info["declaration"]["inputs"][0] == {"name": "x", "unit": "m", "scale": 0.3, "categorical": False}
    assert info["declaration"]["approximator"]["method"] == "local_linear"
    assert done(http.get("/v1/modules/map 1")) == info
    assert done(http.get("/v1/modules")) == {"modules": [info], "next": None}
    assert "DELETE /v1/modules/map 1" in problem(http.post("/v1/modules", json=declaration("map 1")), 409, "conflict")
    assert http.delete("/v1/modules/map 1").status_code == 204
    problem(http.delete("/v1/modules/map 1"), 404, "not_found")
    problem(http.get("/v1/modules/map 1"), 404, "not_found")
    assert done(http.get("/v1/modules")) == {"modules": [], "next": None}


def test_a_module_that_was_deleted_leaves_nothing_to_one_of_the_same_name(http: TestClient) -> None:
    http.post("/v1/modules", json=declaration())
    http.post("/v1/modules/map/samples", json=samples(5))
    http.post("/v1/modules/map/snapshots", json={"name": "before"})
    http.delete("/v1/modules/map")
    problem(http.post("/v1/modules/map/query", json={"inputs": [[0.0, 0.0]]}), 404, "not_found")
    done(http.post("/v1/modules", json=declaration(category=True)), 201)
    assert done(http.get("/v1/modules/map"))["samples"] == 0
    assert done(http.get("/v1/modules/map/snapshots")) == {"snapshots": []}
    problem(http.post("/v1/modules/map/query", json={"inputs": [[0.0, 0.0, 0.0]]}), 409, "not_taught")


@pytest.mark.parametrize(
    ("body", "wrong"),
    [
        (changed(name=""), "body.name"),
        (changed(name="a/b"), "body.name"),
        (changed(name=" a"), "body.name"),
        (changed(name="a\n"), "body.name"),
        (changed(name="a\u0000"), "body.name"),
        (changed(name="a" * 80), "body.name"),
        (changed(name=5), "body.name"),
        (changed(inputs=[]), "body.inputs"),
        (changed(outputs=[]), "body.outputs"),
        (changed(inputs=[{"name": f"x{i}", "unit": ""} for i in range(257)]), "body.inputs"),
        (changed(inputs=[{"name": "x" * 101, "unit": ""}]), "body.inputs.0.name"),
        (changed(inputs=[{"name": "x", "unit": "m" * 41}]), "body.inputs.0.unit"),
        (changed(inputs=[{"name": "x", "unit": "m", "scale": 0}]), "body.inputs.0.scale"),
        (changed(inputs=[{"name": "x", "unit": "m", "scale": 1e-320}]), "body.inputs.0.scale"),
        (changed(inputs=[{"name": "x", "unit": "m", "scale": 1e300}]), "body.inputs.0.scale"),
        (changed(inputs=[{"name": "x", "unit": "m", "colour": "red"}]), "body.inputs.0.colour"),
        (changed(approximator={"method": "guess"}), "body.approximator.method"),
        (changed(approximator={"neighbours": 0}), "body.approximator.neighbours"),
        (changed(approximator={"neighbours": 10**30}), "body.approximator.neighbours"),
        (changed(approximator={"neighbours": 1001}), "body.approximator.neighbours"),
        (changed(approximator={"neighbours": "5"}), "body.approximator.neighbours"),
        (changed(approximator={"neighbours": True}), "body.approximator.neighbours"),
        (changed(approximator={"keep_covered": 1}), "body.approximator.keep_covered"),
        (changed(approximator={"method": "kndb2", "neighbours": 101}), "body.approximator"),
        (changed(approximator={"alpha": 1e300}), "body.approximator.alpha"),
        (changed(colour="red"), "body.colour"),
        ({}, "body.name"),
    ],
)
def test_wrong_declarations_name_the_field(http: TestClient, body: dict[str, Any], wrong: str) -> None:
    response = http.post("/v1/modules", json=body)
    problem(response, 422, "invalid_argument")
    assert wrong in [field["location"] for field in response.json()["fields"]]
    assert done(http.get("/v1/modules"))["modules"] == []


@pytest.mark.parametrize(
    ("inputs", "outputs", "wrong"),
    [
        ([{"name": "x", "unit": "", "categorical": True}], [{"name": "u", "unit": ""}], "not a category"),
        ([{"name": "x", "unit": ""}] * 2, [{"name": "u", "unit": ""}], "share a name"),
        ([{"name": "x", "unit": ""}], [{"name": "u", "unit": ""}] * 2, "share a name"),
    ],
)
def test_declarations_that_make_no_sense_say_why(http: TestClient, inputs: Any, outputs: Any, wrong: str) -> None:
    response = http.post("/v1/modules", json=changed(inputs=inputs, outputs=outputs))
    assert wrong in problem(response, 422, "invalid_argument")


def test_a_quadratic_fit_takes_no_more_inputs_than_it_can(http: TestClient) -> None:
    """With 60 it would take a second for each answer, and a minute to be taught 60 samples."""
    ins = [{"name": f"x{i}", "unit": ""} for i in range(21)]
    quadratic = {"method": "local_quadratic"}
    wide = http.post("/v1/modules", json=changed(inputs=ins, approximator=quadratic))
    assert "local_linear takes more" in problem(wide, 422, "invalid_argument")
    done(http.post("/v1/modules", json=changed(inputs=ins)), 201)
    train = http.post("/v1/modules/map/train", json={"approximator": quadratic})
    assert "local_linear takes more" in problem(train, 422, "invalid_argument")
    assert done(http.get("/v1/jobs"))["jobs"] == []
    ins[0]["categorical"] = True  # type: ignore[assignment]
    done(http.post("/v1/modules", json=changed(name="other", inputs=ins, approximator=quadratic)), 201)


def test_modules_come_in_pages_by_name(http: TestClient) -> None:
    for name in ("b", "d", "a", "c", "e"):
        http.post("/v1/modules", json=declaration(name))
    first = done(http.get("/v1/modules", params={"limit": 2}))
    second = done(http.get("/v1/modules", params={"limit": 2, "cursor": first["next"]}))
    third = done(http.get("/v1/modules", params={"limit": 2, "cursor": second["next"]}))
    names = [module["name"] for page in (first, second, third) for module in page["modules"]]
    assert (names, third["next"]) == (["a", "b", "c", "d", "e"], None)
    for limit in ("0", "1001", "many", "-1", "1.5"):
        problem(http.get("/v1/modules", params={"limit": limit}), 422, "invalid_argument")


def test_the_largest_module_can_be_taught_and_asked(http: TestClient) -> None:
    ins = [{"name": f"x{i}", "unit": ""} for i in range(256)]
    outs = [{"name": f"u{i}", "unit": ""} for i in range(256)]
    done(http.post("/v1/modules", json=changed(inputs=ins, outputs=outs)), 201)
    random = np.random.default_rng(0)
    body = packed(inputs=random.normal(size=(40, 256)), outputs=random.normal(size=(40, 256)))
    done(http.post("/v1/modules/map/samples", content=body, headers=NPZ), 201)
    queries = packed(inputs=random.normal(size=(200, 256)), neighbours=3)
    found = unpacked(http.post("/v1/modules/map/query", content=queries, headers=NPZ).content)
    assert found["outputs"].shape == (200, 256)
    assert np.isfinite(found["outputs"]).all()


# --- training, statistics, drawing ----------------------------------------------------------------------------------


def test_training_anew_takes_other_settings(http: TestClient) -> None:
    http.post("/v1/modules", json=declaration())
    http.post("/v1/modules/map/samples", json=samples(60))
    before = told(http)
    job = ended(http, http.post("/v1/modules/map/train", json={"approximator": {"method": "nearest"}}))
    assert (job["kind"], job["subject"], job["state"], job["progress"]) == ("train", "map", "succeeded", 1.0)
    assert job["result"]["samples"] == 60
    assert told(http) != before
    assert done(http.get("/v1/modules/map"))["declaration"]["approximator"]["method"] == "nearest"
    same = ended(http, http.post("/v1/modules/map/train"))  # as before, that is nearest
    assert same["state"] == "succeeded"
    assert done(http.get("/v1/modules/map"))["declaration"]["approximator"]["method"] == "nearest"
    ended(http, http.post("/v1/modules/map/train", json={"approximator": {"method": "local_linear"}}))
    assert told(http) == before
    problem(http.post("/v1/modules/map/train", json={"approximator": "nearest"}), 422, "invalid_argument")
    empty = http.post("/v1/modules", json=declaration("empty"))
    job = ended(http, http.post(f"{empty.headers['location']}/train"))
    assert (job["state"], job["result"]) == ("succeeded", {"module": "empty", "samples": 0, "categories": []})


def test_statistics_and_trees_are_by_category(http: TestClient) -> None:
    http.post("/v1/modules", json=declaration(category=True))
    assert done(http.get("/v1/modules/map/statistics")) == {"module": "map", "samples": 0, "categories": []}
    inputs, outputs = taught(90)
    parts = np.repeat([0.0, 1.0, 2.5], 30)
    body = packed(inputs=np.column_stack([parts, inputs]), outputs=outputs, demonstrations=["a", "b", "c"] * 30)
    done(http.post("/v1/modules/map/samples", content=body, headers=NPZ), 201)
    statistics = done(http.get("/v1/modules/map/statistics"))
    assert [each["category"] for each in statistics["categories"]] == [[0.0], [1.0], [2.5]]
    assert [each["samples"] for each in statistics["categories"]] == [30, 30, 30]
    assert [each["demonstrations"] for each in statistics["categories"]] == [3, 3, 3]
    for category in ("0", "1", "2.5"):
        tree = done(http.get("/v1/modules/map/tree", params={"category": category}))
        assert tree["components"] == ["x", "y"]
        assert tree["radii"] == sorted(tree["radii"], reverse=True)
        root, *others = tree["nodes"]
        assert (root["number"], root["parent"], root["point"], root["level"]) == (0, None, None, 0)
        assert root["children"] == sum(node["parent"] == 0 for node in others)
        assert all(node["parent"] < node["number"] for node in others)
        assert not tree["truncated"]
        # Points are in the declared units.
        assert all(min(np.abs(inputs - node["point"]).max(axis=1)) < 1e-9 for node in others)
    for query in ({}, {"category": "7"}, {"category": ["0", "1"]}, {"category": "nan"}, {"category": "inf"}):
        assert "statistics" in problem(http.get("/v1/modules/map/tree", params=query), 404, "not_found")
    problem(http.get("/v1/modules/map/tree", params={"category": "first"}), 422, "invalid_argument")
    (answer,) = done(http.post("/v1/modules/map/query", json={"inputs": [[2.5, 0.0, 0.0]]}))["answers"]
    assert {neighbour["sample"] for neighbour in answer["neighbours"]} <= set(range(60, 90))
    mixed = {"inputs": [[2.5, 0.0, 0.0], [7.0, 0.0, 0.0]]}
    assert "(7.0,)" in problem(http.post("/v1/modules/map/query", json=mixed), 409, "not_taught")


def test_a_tree_without_categories_needs_none(http: TestClient) -> None:
    http.post("/v1/modules", json=declaration())
    problem(http.get("/v1/modules/map/tree"), 404, "not_found")
    http.post("/v1/modules/map/samples", json=samples(1))
    assert len(done(http.get("/v1/modules/map/tree"))["nodes"]) <= 2
    assert done(http.get("/v1/modules/map/statistics"))["categories"][0]["median_reach"] == 0.0
    problem(http.get("/v1/modules/map/tree", params={"category": "0"}), 404, "not_found")
    http.delete("/v1/modules/map/samples", params={"number": 0})
    problem(http.get("/v1/modules/map/tree"), 404, "not_found")
    assert done(http.get("/v1/modules/map/statistics"))["categories"] == []


def test_a_large_tree_is_cut_and_says_so(http: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("handeye.server.statistics.MOST_NODES", 10)
    http.post("/v1/modules", json=declaration())
    http.post("/v1/modules/map/samples", json=samples(200))
    tree = done(http.get("/v1/modules/map/tree"))
    assert (len(tree["nodes"]), tree["truncated"]) == (10, True)


# --- export and import ----------------------------------------------------------------------------------------------


def test_an_exported_module_answers_the_same_elsewhere(http: TestClient, tmp_path: Path) -> None:
    http.post("/v1/modules", json=declaration(category=True, method="local_quadratic"))
    inputs, outputs = taught(80)
    rows = np.column_stack([np.arange(80) % 2, inputs])
    body = packed(inputs=rows, outputs=outputs, demonstrations=["größe-1", ""] * 40)
    done(http.post("/v1/modules/map/samples", content=body, headers=NPZ), 201)
    http.delete("/v1/modules/map/samples", params={"number": [3, 70]})
    http.post("/v1/modules/map/samples", json={"samples": [{"input": [0, 0.1, 0.2], "output": [0.3, 0.4]}]})
    exported = http.get("/v1/modules/map/export")
    assert exported.headers["content-type"] == "application/x-npz"
    assert "attachment" in exported.headers["content-disposition"]
    arrays = unpacked(exported.content)
    assert arrays["numbers"].tolist() == [n for n in range(81) if n not in (3, 70)]
    np.testing.assert_array_equal(arrays["inputs"][:3], rows[:3])

    query = {"inputs": [[0.0, 0.3, 0.1], [1.0, -0.5, 0.4]], "neighbours": 0}
    with Store.open(f"sqlite:///{tmp_path / 'elsewhere.db'}") as store, open_lab(store) as lab, asking(lab) as there:
        imported = there.post("/v1/modules/import", content=exported.content, headers=NPZ)
        assert imported.headers["location"] == "/v1/modules/map"
        assert done(imported, 201)["samples"] == 79
        assert done(imported, 201)["declaration"] == done(http.get("/v1/modules/map"))["declaration"]
        problem(there.post("/v1/modules/import", content=exported.content, headers=NPZ), 409, "conflict")
        renamed = there.post("/v1/modules/import", params={"name": "map 2"}, content=exported.content, headers=NPZ)
        assert done(renamed, 201)["name"] == done(renamed, 201)["declaration"]["name"] == "map 2"
        ended(http, http.post("/v1/modules/map/train"))  # support is then calibrated as freshly as there
        here = http.post("/v1/modules/map/query", json=query).content
        for name in ("map", "map 2"):
            assert there.post(f"/v1/modules/{name}/query", json=query).content == here
        listed = done(there.get("/v1/modules/map/samples", params={"limit": 1000}))["samples"]
        assert [each["number"] for each in listed] == list(range(79))
        assert {each["demonstration"] for each in listed} == {"größe-1", None}


def test_a_module_without_samples_is_carried_too(http: TestClient) -> None:
    http.post("/v1/modules", json=declaration())
    content = http.get("/v1/modules/map/export").content
    imported = http.post("/v1/modules/import?name=other", content=content, headers=NPZ)
    assert done(imported, 201)["samples"] == 0
    problem(http.post("/v1/modules/import?name=a/b", content=content, headers=NPZ), 422, "invalid_argument")
    problem(http.post("/v1/modules/import?name=more", content=b"", headers=NPZ), 400, "malformed")
    problem(http.post("/v1/modules/import?name=more", content=content), 415, "unsupported_media_type")
    problem(http.post("/v1/modules/import?name=more", json={}), 415, "unsupported_media_type")
    problem(http.get("/v1/modules/nobody/export"), 404, "not_found")


@pytest.mark.parametrize(
    ("arrays", "wrong"),
    [
        ({"declaration": np.array("{}")}, "name"),
        ({"declaration": np.array("no JSON")}, "declaration"),
        ({"declaration": np.array('{"name": "\ud800"}')}, "declaration"),
        ({"declaration": np.array(5)}, "no string 'declaration'"),
        ({"declaration": np.array(["{}"])}, "no string 'declaration'"),
        ({"declaration": None}, "no string 'declaration'"),
        ({"inputs": None}, "'inputs'"),
        ({"inputs": np.zeros((3, 5))}, "2 components"),
        ({"inputs": np.full((3, 2), np.nan)}, "finite"),
        ({"outputs": np.zeros((4, 2))}, "each sample needs one of each"),
        ({"outputs": np.zeros(())}, "2 components"),
        ({"inputs": np.zeros((0, 2)), "demonstrations": np.zeros(0, "U1")}, "shape (0, 2)"),
        ({"inputs": np.zeros(2), "demonstrations": np.zeros(2, "U1")}, "2 components"),
        ({"demonstrations": np.array(["a/b"] * 3)}, "called"),
        ({"demonstrations": np.array(["a"] * 2)}, "3 strings"),
        ({"weights": np.zeros(3)}, "weights"),
    ],
)
def test_files_that_make_no_module_say_why(http: TestClient, arrays: dict[str, Any], wrong: str) -> None:
    http.post("/v1/modules", json=declaration())
    http.post("/v1/modules/map/samples", json=samples(3))
    sound = unpacked(http.get("/v1/modules/map/export").content)
    mixed = {name: array for name, array in (sound | arrays).items() if array is not None}
    response = http.post("/v1/modules/import?name=other", content=packed(**mixed), headers=NPZ)
    assert wrong in problem(response, 422, "invalid_argument")
    problem(http.get("/v1/modules/other"), 404, "not_found")


def test_a_module_that_cannot_be_built_harms_no_other_and_can_be_mended(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open_lab(store) as lab, asking(lab) as http:
        for name in ("map", "other"):
            http.post("/v1/modules", json=declaration(name))
            http.post(f"/v1/modules/{name}/samples", json=samples(5))
    restored = Module.restored

    def fails(declaration: ModuleDeclaration, taught: TaughtSamples, size: int) -> Module:
        if declaration.name == "map" and 3 in taught.numbers:
            raise ZeroDivisionError
        return restored(declaration, taught, size)

    monkeypatch.setattr(Module, "restored", fails)
    with open_lab(store) as lab, asking(lab) as http:
        told(http, "other")
        query = {"inputs": [[0.0, 0.0]]}
        assert "could not be built" in problem(http.post("/v1/modules/map/query", json=query), 503, "not_ready")
        problem(http.post("/v1/modules/map/samples", json=samples(1)), 503, "not_ready")
        assert done(http.get("/v1/modules/map"))["samples"] == 5
        assert len(done(http.get("/v1/modules"))["modules"]) == 2
        assert ended(http, http.post("/v1/modules/map/train"))["state"] == "failed"
        assert done(http.delete("/v1/modules/map/samples", params={"number": 3})) == {"removed": 1}
        told(http)


def test_a_name_in_a_file_has_to_be_one(http: TestClient) -> None:
    http.post("/v1/modules", json=declaration())
    sound = unpacked(http.get("/v1/modules/map/export").content)
    text = str(sound.pop("declaration")).replace('"map"', '"a/b"')
    body = packed(declaration=np.array(text), **sound)
    assert "name" in problem(http.post("/v1/modules/import", content=body, headers=NPZ), 422, "invalid_argument")


def test_metrics_forget_a_module_that_was_deleted(lab: Lab, http: TestClient) -> None:
    http.post("/v1/modules", json=declaration())
    http.post("/v1/modules/map/samples", json=samples(3))
    told(http)
    counted = http.get("/metrics").text
    assert 'handeye_samples_written_total{module="map"} 3.0' in counted
    assert 'handeye_queries_total{module="map"} 7.0' in counted
    http.delete("/v1/modules/map")
    assert 'module="map"' not in http.get("/metrics").text
