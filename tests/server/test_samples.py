"""Samples over REST, as JSON and as arrays: taught, told in pages, removed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.server.rest import NPZ, declaration, done, packed, problem, samples, taught, unpacked

if TYPE_CHECKING:
    from starlette.testclient import TestClient

    from tests.server.conftest import Lab


# --- teaching -------------------------------------------------------------------------------------------------------


def test_samples_are_numbered_and_the_next_query_knows_them(http: TestClient, module: str) -> None:
    problem(http.post(f"{module}/query", json={"inputs": [[0.1, 0.2]]}), 409, "not_taught")
    assert done(http.post(f"{module}/samples", json=samples(5)), 201) == {"first": 0, "count": 5, "samples": 5}
    assert done(http.post(f"{module}/samples", json=samples(3, seed=1)), 201) == {"first": 5, "count": 3, "samples": 8}
    inputs, outputs = taught(3, seed=1)
    (answer,) = done(http.post(f"{module}/query", json={"inputs": [inputs[1].tolist()], "neighbours": 2}))["answers"]
    assert answer["neighbours"][0]["sample"] == 6
    assert answer["neighbours"][0]["distance"] == 0.0
    assert len(answer["neighbours"]) == 2
    assert len(answer["output"]) == len(outputs[1])


def test_samples_as_arrays_are_the_same_samples(http: TestClient, module: str) -> None:
    inputs, outputs = taught(4)
    body = packed(inputs=inputs, outputs=outputs, demonstrations=["a-1", "", "a-1", "größe 2"])
    assert done(http.post(f"{module}/samples", content=body, headers=NPZ), 201)["count"] == 4
    listed = done(http.get(f"{module}/samples"))["samples"]
    assert [each["demonstration"] for each in listed] == ["a-1", None, "a-1", "größe 2"]
    assert [each["input"] for each in listed] == inputs.tolist()
    assert [each["output"] for each in listed] == outputs.tolist()


def test_ten_thousand_samples_and_queries_at_once(http: TestClient, module: str) -> None:
    inputs, _outputs = taught(10_000)
    assert done(http.post(f"{module}/samples", json=samples(10_000)), 201)["samples"] == 10_000
    asked = done(http.post(f"{module}/query", json={"inputs": inputs.tolist(), "neighbours": 1}))["answers"]
    assert [answer["neighbours"][0]["sample"] for answer in asked] == list(range(10_000))
    body = packed(inputs=inputs, neighbours=1)
    told = unpacked(http.post(f"{module}/query", content=body, headers=NPZ).content)
    assert told["samples"][:, 0].tolist() == list(range(10_000))
    assert told["outputs"].tolist() == [answer["output"] for answer in asked]
    too_many = np.zeros((10_001, 2))
    wrong = http.post(f"{module}/samples", content=packed(inputs=too_many, outputs=too_many), headers=NPZ)
    assert "several requests" in problem(wrong, 422, "invalid_argument")
    problem(http.post(f"{module}/samples", json=samples(10_001)), 422, "invalid_argument")
    problem(http.post(f"{module}/query", json={"inputs": too_many.tolist()}), 422, "invalid_argument")


@pytest.mark.parametrize(
    ("sample", "wrong"),
    [
        ({"input": [0.0], "output": [0.0, 0.0]}, "2 components"),
        ({"input": [0.0, 0.0, 0.0], "output": [0.0, 0.0]}, "2 components"),
        ({"input": [0.0, 0.0], "output": [0.0]}, "2 components"),
        ({"input": [], "output": []}, "at least 1 item"),
        ({"input": [0.0, 0.0]}, "output"),
        ({"input": [0.0, 0.0], "output": [0.0, 0.0], "colour": "blue"}, "colour"),
        ({"input": [0.0, 0.0], "output": [0.0, 0.0], "demonstration": "a/b"}, "demonstration"),
        ({"input": [0.0, 0.0], "output": [0.0, 0.0], "demonstration": ""}, "demonstration"),
        ({"input": [0.0, "much"], "output": [0.0, 0.0]}, "input.1"),
        ({"input": [0.0, None], "output": [0.0, 0.0]}, "input.1"),
        ({"input": [0.0, 1e200], "output": [0.0, 0.0]}, "magnitude"),
        ({"input": "01", "output": [0.0, 0.0]}, "input"),
    ],
)
def test_wrong_samples_are_refused_and_none_is_learned(
    http: TestClient, module: str, sample: dict[str, object], wrong: str
) -> None:
    body = {"samples": [sample]}
    assert wrong in problem(http.post(f"{module}/samples", json=body), 422, "invalid_argument")
    assert done(http.get(module))["samples"] == 0


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_what_is_not_finite_is_refused(http: TestClient, module: str, number: str) -> None:
    body = f'{{"samples": [{{"input": [0.0, {number}], "output": [0.0, 0.0]}}]}}'
    wrong = http.post(f"{module}/samples", content=body, headers={"Content-Type": "application/json"})
    assert "finite" in problem(wrong, 422, "invalid_argument")
    asked = f'{{"inputs": [[{number}, 0.0]]}}'
    wrong = http.post(f"{module}/query", content=asked, headers={"Content-Type": "application/json"})
    assert "finite" in problem(wrong, 422, "invalid_argument")
    arrays = packed(inputs=[[0.0, float(number)]], outputs=[[0.0, 0.0]])
    assert "finite" in problem(http.post(f"{module}/samples", content=arrays, headers=NPZ), 422, "invalid_argument")
    asked_arrays = packed(inputs=[[0.0, float(number)]])
    http.post(f"{module}/samples", json=samples(3))
    wrong = http.post(f"{module}/query", content=asked_arrays, headers=NPZ)
    assert "finite" in problem(wrong, 422, "invalid_argument")


@pytest.mark.parametrize(
    ("body", "status", "code"),
    [
        (b"", 400, "malformed"),
        (b"{", 400, "malformed"),
        (b'{"samples": [', 400, "malformed"),
        (b"\xff\xfe", 400, "malformed"),
        (b'{"samples": "\\ud800"}', 400, "malformed"),
        (b'{"inputs":' + b"[" * 100_000, 400, "malformed"),
        (b"[]", 422, "invalid_argument"),
        (b"null", 422, "invalid_argument"),
        (b'{"samples": []}', 422, "invalid_argument"),
        (b'{"samples": [], "inputs": []}', 422, "invalid_argument"),
        (b'{"samples": [1]}', 422, "invalid_argument"),
        (b"1" * 5000, 400, "malformed"),
    ],
)
def test_bodies_that_are_no_json_or_no_samples(
    http: TestClient, module: str, body: bytes, status: int, code: str
) -> None:
    for path in ("samples", "query"):
        wrong = http.post(f"{module}/{path}", content=body, headers={"Content-Type": "application/json"})
        sentence = problem(wrong, status, code)
        assert "character body" not in sentence
        assert len(sentence) < 500


def test_a_flood_of_wrong_values_is_refused_at_the_first(http: TestClient, module: str) -> None:
    flood = b'""' + b',""' * 200_000
    for path, body in (
        ("query", b'{"inputs":[[' + flood + b"]]}"),
        ("query", b'{"inputs":[' + flood + b"]}"),
        ("samples", b'{"samples":[{"input":[' + flood + b'],"output":[0]}]}'),
        ("samples", b'{"samples":[' + b"{}" + b",{}" * 9_999 + b"]}"),
    ):
        wrong = http.post(f"{module}/{path}", content=body, headers={"Content-Type": "application/json"})
        problem(wrong, 422, "invalid_argument")
        assert len(wrong.json()["fields"]) <= 3, path


def test_other_types_of_bodies_are_refused(http: TestClient, module: str) -> None:
    for kind in ("text/csv", "application/x-npy", "x" * 1000):
        wrong = http.post(f"{module}/samples", content=b"1,2", headers={"Content-Type": kind})
        assert len(problem(wrong, 415, "unsupported_media_type")) < 400


def test_an_unknown_module_is_named(http: TestClient) -> None:
    for response in (
        http.post("/v1/modules/nobody/samples", json=samples(1)),
        http.post("/v1/modules/nobody/query", json={"inputs": [[0.0, 0.0]]}),
        http.get("/v1/modules/nobody/samples"),
        http.delete("/v1/modules/nobody/samples", params={"number": 1}),
    ):
        assert "'nobody'" in problem(response, 404, "not_found")


# --- pages and removal ----------------------------------------------------------------------------------------------


def test_samples_come_in_pages(http: TestClient, module: str) -> None:
    http.post(f"{module}/samples", json=samples(25))
    http.delete(f"{module}/samples", params={"number": [3, 4]})
    seen: list[int] = []
    more: dict[str, Any] = {"limit": 10}
    for _ in range(3):
        page = done(http.get(f"{module}/samples", params=more))
        seen += [sample["number"] for sample in page["samples"]]
        more["cursor"] = page["next"]
    assert page["next"] is None
    assert seen == [n for n in range(25) if n not in (3, 4)]
    exact = done(http.get(f"{module}/samples", params={"limit": 23}))
    assert (len(exact["samples"]), exact["next"]) == (23, None)


NO_CURSORS = (
    *("x", "", "\u00e9", "//", "W10=", "bnVsbA=="),  # the last two: [], null
    *("WzFd" * 90, "WzEuNV0=", "W3RydWVd", "Wy0xXQ=="),  # [1][1]..., [1.5], [true], [-1]
    "WzE4NDQ2NzQ0MDczNzA5NTUxNjE1XQ==",  # [18446744073709551615]
    "WyJcdTAwMDAiXQ==",  # ["\\u0000"]
)


def test_cursors_that_no_page_gave_are_malformed(http: TestClient, module: str) -> None:
    for path in ("/v1/modules", f"{module}/samples", "/v1/demonstrations", "/v1/jobs"):
        for cursor in NO_CURSORS:
            response = http.get(path, params={"cursor": cursor})
            assert "cursor" in problem(response, 400, "malformed"), (path, cursor)


def test_removal_counts_at_the_next_query(http: TestClient, module: str) -> None:
    http.post(f"{module}/samples", json=samples(5))
    query = {"inputs": [taught(5)[0][2].tolist()], "neighbours": 10}

    def near() -> set[int]:
        (answer,) = done(http.post(f"{module}/query", json=query))["answers"]
        return {neighbour["sample"] for neighbour in answer["neighbours"]}

    assert near() == {0, 1, 2, 3, 4}
    assert done(http.delete(f"{module}/samples", params={"number": [2, 4, 2]})) == {"removed": 2}
    assert near() == {0, 1, 3}
    unknown = http.delete(f"{module}/samples", params={"number": [1, 2]})
    assert "no sample 2" in problem(unknown, 404, "not_found")
    assert near() == {0, 1, 3}
    done(http.delete(f"{module}/samples", params={"number": [0, 1, 3]}))
    problem(http.post(f"{module}/query", json=query), 409, "not_taught")
    assert done(http.post(f"{module}/samples", json=samples(1)), 201) == {"first": 5, "count": 1, "samples": 1}


def test_a_demonstrations_samples_leave_together(http: TestClient, module: str) -> None:
    http.post(f"{module}/samples", json=samples(3, demonstration="tasse à thé"))
    http.post(f"{module}/samples", json=samples(2, seed=1))
    assert done(http.get(module))["demonstrations"] == 1
    assert done(http.delete(f"{module}/samples", params={"demonstration": "tasse à thé"})) == {"removed": 3}
    again = http.delete(f"{module}/samples", params={"demonstration": "tasse à thé"})
    assert "'tasse à thé'" in problem(again, 404, "not_found")
    assert done(http.get(module))["samples"] == 2


def test_what_to_remove_has_to_be_said(http: TestClient, module: str) -> None:
    for query in (
        *("", "?number=1&demonstration=a", "?number=-1", "?number=9223372036854775808", "?number=1e3"),
        *("?demonstration=", f"?number={'9' * 5000}", "?" + "&".join(f"number={n}" for n in range(1001))),
    ):
        problem(http.delete(f"{module}/samples{query}"), 422, "invalid_argument")


def test_the_largest_number_is_just_unknown(http: TestClient, module: str) -> None:
    problem(http.delete(f"{module}/samples?number={2**63 - 1}"), 404, "not_found")


def test_names_in_all_scripts(http: TestClient, module: str) -> None:
    names = ["blauer Becher", "तश्तरी 2", "青い茶碗", "чашка-1", "e\u0301tude"]
    inputs, outputs = taught(len(names))
    arrays = packed(inputs=inputs, outputs=outputs, demonstrations=names)
    done(http.post(f"{module}/samples", content=arrays, headers=NPZ), 201)
    for name in names:
        done(http.post(f"{module}/samples", json=samples(1, demonstration=name)), 201)
        assert done(http.delete(f"{module}/samples", params={"demonstration": name})) == {"removed": 2}
        other = http.post("/v1/modules", json=declaration(name))
        assert done(http.get(other.headers["location"]))["name"] == name


def test_a_sample_survives_a_failing_memory(
    lab: Lab, http: TestClient, module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    http.post(f"{module}/samples", json=samples(3))
    live = lab.coordinator.modules.live("map")
    monkeypatch.setattr(live, "learn", lambda *_: 1 / 0)
    assert done(http.post(f"{module}/samples", json=samples(2, seed=1)), 201)["samples"] == 5
    assert lab.coordinator.modules.live("map").samples == 5
    monkeypatch.setattr(lab.coordinator.modules.live("map"), "forget", lambda *_: 1 / 0)
    assert done(http.delete(f"{module}/samples", params={"number": 0})) == {"removed": 1}
    assert lab.coordinator.modules.live("map").samples == 4
