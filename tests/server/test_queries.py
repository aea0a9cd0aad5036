"""Queries over REST, as JSON and as arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.server.rest import NPZ, declaration, done, packed, problem, samples, taught, unpacked

if TYPE_CHECKING:
    from starlette.testclient import TestClient


def test_json_and_arrays_tell_the_same(http: TestClient, module: str) -> None:
    inputs, outputs = taught(40)
    shown = ["" if i % 3 == 0 else f"d-{i % 3}" for i in range(40)]
    done(
        http.post(
            f"{module}/samples", content=packed(inputs=inputs, outputs=outputs, demonstrations=shown), headers=NPZ
        ),
        201,
    )
    queries = taught(50, seed=5)[0]
    told = done(http.post(f"{module}/query", json={"inputs": queries.tolist(), "neighbours": 4}))["answers"]
    response = http.post(f"{module}/query", content=packed(inputs=queries, neighbours=4), headers=NPZ)
    assert response.headers["content-type"] == "application/x-npz"
    arrays = unpacked(response.content)
    assert set(arrays) == {
        "outputs", "support", "expected_error", "samples", "demonstrations", "distances", "weights", "names"
    }  # fmt: skip
    assert arrays["samples"].shape == arrays["weights"].shape == (50, 4)
    names = [*arrays["names"].tolist(), None]
    for row, answer in enumerate(told):
        assert answer["output"] == arrays["outputs"][row].tolist()
        assert answer["support"] == arrays["support"][row]
        assert answer["expected_error"] == arrays["expected_error"][row].tolist()
        assert answer["neighbours"] == [
            {"sample": sample, "demonstration": names[shown], "distance": distance, "weight": weight}
            for sample, shown, distance, weight in zip(
                arrays["samples"][row].tolist(),
                arrays["demonstrations"][row].tolist(),
                arrays["distances"][row].tolist(),
                arrays["weights"][row].tolist(),
                strict=True,
            )
        ]
    default = unpacked(http.post(f"{module}/query", content=packed(inputs=queries), headers=NPZ).content)
    assert default["samples"].shape == (50, 10)


@pytest.mark.parametrize("neighbours", [-1, 1001, 10**30, "many", None, 1.5])
def test_how_many_neighbours_are_told_has_bounds(http: TestClient, module: str, neighbours: Any) -> None:
    http.post(f"{module}/samples", json=samples(3))
    asked = {"inputs": [[0.0, 0.0]], "neighbours": neighbours}
    assert "neighbours" in problem(http.post(f"{module}/query", json=asked), 422, "invalid_argument")


@pytest.mark.parametrize("neighbours", [-1, 1001, np.nan, np.inf, 1.5, [1, 2], "many", 1e300])
def test_the_same_for_arrays(http: TestClient, module: str, neighbours: Any) -> None:
    http.post(f"{module}/samples", json=samples(3))
    body = packed(inputs=np.zeros((1, 2)), neighbours=neighbours)
    wrong = http.post(f"{module}/query", content=body, headers=NPZ)
    assert "neighbours" in problem(wrong, 422, "invalid_argument")


def test_without_neighbours_there_is_just_the_answer(http: TestClient, module: str) -> None:
    http.post(f"{module}/samples", json=samples(3))
    (answer,) = done(http.post(f"{module}/query", json={"inputs": [[0.0, 0.0]], "neighbours": 0}))["answers"]
    assert answer["neighbours"] == []


def test_vectors_of_different_lengths_are_told(http: TestClient, module: str) -> None:
    http.post(f"{module}/samples", json=samples(3))
    asked = {"inputs": [[0.0, 0.0], [0.0]]}
    assert "differ in length" in problem(http.post(f"{module}/query", json=asked), 422, "invalid_argument")
    assert "2 components" in problem(http.post(f"{module}/query", json={"inputs": [[0.0]]}), 422, "invalid_argument")
    problem(http.post(f"{module}/query", json={"inputs": [[0.0, 0.0]], "more": 1}), 422, "invalid_argument")


def test_one_sample_has_no_expected_error_yet(http: TestClient, module: str) -> None:
    http.post(f"{module}/samples", json=samples(1))
    (answer,) = done(http.post(f"{module}/query", json={"inputs": [[0.0, 0.0]]}))["answers"]
    assert answer["expected_error"] == [None, None]


def test_extreme_numbers_are_answered_or_refused(http: TestClient) -> None:
    tiny = declaration("tiny")
    tiny["inputs"][0]["scale"] = 1e-9
    at = http.post("/v1/modules", json=tiny).headers["location"]
    body = {"samples": [{"input": [1e149, 0.0], "output": [0.0, 0.0]}]}
    assert "scale" in problem(http.post(f"{at}/samples", json=body), 422, "invalid_argument")
    http.post(f"{at}/samples", json=samples(3))
    assert "scale" in problem(http.post(f"{at}/query", json={"inputs": [[1e149, 0.0]]}), 422, "invalid_argument")
    done(http.post(f"{at}/query", json={"inputs": [[1e-300, -0.0]]}))
