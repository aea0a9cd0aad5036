"""Modules: samples and queries as arrays, in batches; what cannot be one is not sent."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import pytest

from handeye.client import ApiError, PartlyAdded, UnexpectedAnswer, Unreachable, WrongArrays
from handeye.client.models import Component, Declaration, Output
from tests.client.conftest import Connect, Script, event, job, problem, streamed

DECLARATION: dict[str, Any] = {
    "name": "reach/near",
    "inputs": [{"name": "x", "unit": "m", "scale": 0.1, "categorical": False, "newer": 1}],
    "outputs": [{"name": "turn", "unit": "rad"}],
    "approximator": {"method": "kndb"},
}
INFO = {
    "name": "reach/near",
    "declaration": DECLARATION,
    "samples": 3,
    "demonstrations": 1,
    "created": "2026-11-01T10:00:00Z",
}
STATISTICS = {
    "module": "reach/near",
    "samples": 3,
    "categories": [
        {
            "category": [1.0],
            "samples": 3,
            "demonstrations": 1,
            "nodes": 4,
            "levels": 2,
            "median_reach": 0.1,
            "largest_reach": 0.2,
        }
    ],
}


class Memory:
    """A coordinator that keeps samples, and answers queries with their own first numbers."""

    def __init__(self, refuse_after: int = 1000, most_neighbours: int = 3) -> None:
        self.batches: list[dict[str, np.ndarray]] = []
        self.total = 0
        self.asked: list[httpx2.Request] = []
        self._refuse_after = refuse_after
        self._most = most_neighbours

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        assert request.headers["content-type"] == "application/x-npz"
        with np.load(io.BytesIO(request.content), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        self.asked.append(request)
        if request.url.path.endswith("/query"):
            self.neighbours = int(arrays["neighbours"])
            assert request.headers["accept"] == "application/x-npz"
            return httpx2.Response(200, content=self._answer(arrays["inputs"]))
        if len(self.batches) >= self._refuse_after:
            return problem(422, "invalid_argument", "There is something wrong.")
        self.batches.append(arrays)
        first, count = self.total, len(arrays["inputs"])
        self.total += count
        return httpx2.Response(201, json={"first": first, "count": count, "samples": self.total})

    def _answer(self, rows: np.ndarray) -> bytes:
        # Later batches have fewer neighbours than the first.
        count, near = len(rows), max(1, self._most - (len(self.asked) - 1))
        file = io.BytesIO()
        np.savez(
            file,
            outputs=rows[:, :1] * 2.0,
            support=np.ones(count),
            expected_error=np.full((count, 1), np.inf),
            samples=np.tile(np.arange(near), (count, 1)),
            distances=np.zeros((count, near)),
            weights=np.full((count, near), 1.0 / near),
            demonstrations=np.tile(np.arange(near) - 1, (count, 1)),
            names=np.array(["first", "second"]),
        )
        return file.getvalue()


def test_a_declaration_goes_and_comes_back(connect: Connect) -> None:
    coordinator = Script(httpx2.Response(201, json=INFO))
    with connect(coordinator) as client:
        made = client.create_module(DECLARATION)
        client.create_module(made.declaration)
    assert made.declaration.inputs[0].scale == 0.1
    assert coordinator.asked[0].url.path == "/v1/modules"
    assert [json.loads(request.content) for request in coordinator.asked] == [DECLARATION, DECLARATION]


def test_a_declaration_may_be_built(connect: Connect) -> None:
    coordinator = Script(httpx2.Response(201, json=INFO))
    built = Declaration(name="m", inputs=(Component(name="x"),), outputs=(Output(name="y", unit="m"),))
    with connect(coordinator) as client:
        client.create_module(built)
    assert json.loads(coordinator.asked[0].content) == {
        "name": "m",
        "inputs": [{"name": "x", "unit": "", "scale": 1.0, "categorical": False}],
        "outputs": [{"name": "y", "unit": "m"}],
    }


def test_modules_are_read(connect: Connect) -> None:
    with connect(Script(httpx2.Response(200, json={"modules": [INFO], "next": None}))) as client:
        assert [module.name for module in client.modules()] == ["reach/near"]
    coordinator = Script(httpx2.Response(200, json=STATISTICS))
    with connect(coordinator) as client:
        assert client.statistics("reach/near").categories[0].levels == 2
    assert coordinator.asked[0].url.raw_path == b"/v1/modules/reach%2Fnear/statistics"


def test_samples_go_in_batches_each_with_its_key(connect: Connect) -> None:
    memory = Memory()
    inputs = np.arange(25_000.0)[:, np.newaxis]
    with connect(memory) as client:
        numbers = client.add_samples("m", inputs, -inputs, [f"d{i % 2}" for i in range(len(inputs))])
    assert [len(batch["inputs"]) for batch in memory.batches] == [10_000, 10_000, 5_000]
    assert np.array_equal(np.concatenate([batch["inputs"] for batch in memory.batches]), inputs)
    assert np.array_equal(np.concatenate([batch["outputs"] for batch in memory.batches]), -inputs)
    assert np.concatenate([batch["demonstrations"] for batch in memory.batches])[:3].tolist() == ["d0", "d1", "d0"]
    assert np.array_equal(numbers, np.arange(25_000))
    assert len({request.headers["idempotency-key"] for request in memory.asked}) == 3


def test_long_vectors_go_in_smaller_batches(connect: Connect) -> None:
    memory = Memory()
    with connect(memory) as client:
        client.add_samples("m", np.zeros((300, 10_000)), np.zeros((300, 1)), "one")
    assert max(len(request.content) for request in memory.asked) < 5 * 2**20
    assert memory.total == 300
    assert set(memory.batches[0]["demonstrations"]) == {"one"}


def test_a_batch_that_is_refused_tells_what_was_kept(connect: Connect) -> None:
    inputs = np.zeros((25_000, 1))
    with connect(Memory(refuse_after=1)) as client, pytest.raises(PartlyAdded, match="first 10000 of 25000") as partly:
        client.add_samples("m", inputs, inputs)
    assert np.array_equal(partly.value.numbers, np.arange(10_000))
    assert isinstance(partly.value.__cause__, ApiError)
    with connect(Memory(refuse_after=0)) as client, pytest.raises(ApiError, match="something wrong"):
        client.add_samples("m", inputs, inputs)


@pytest.mark.parametrize(
    ("inputs", "outputs", "demonstrations", "message"),
    [
        ([[1.0]], [[1.0], [2.0]], None, "1 inputs, 2 outputs"),
        ([[1.0]], [[1.0]], ["a", "b"], "1 inputs, 1 outputs and 2 demonstrations"),
        ([1.0], [[1.0]], None, r"inputs must have shape \(n, components\)"),
        ([], [], None, "n of at least 1"),
        ([[1.0], [np.nan]], [[1.0], [1.0]], None, "row 1 is"),
        ([[1.0]], [[np.inf]], None, "outputs must be finite"),
        ([["a"]], [[1.0]], None, "inputs must be numbers"),
        ([[1.0], [1.0, 2.0]], [[1.0]], None, "inputs must be numbers"),
    ],
)
def test_what_cannot_be_samples_is_not_sent(
    connect: Connect, inputs: Any, outputs: Any, demonstrations: Any, message: str
) -> None:
    memory = Memory()
    with connect(memory) as client, pytest.raises(WrongArrays, match=message):
        client.add_samples("m", inputs, outputs, demonstrations)
    assert not memory.asked


def test_samples_come_page_by_page_as_they_are_wanted(connect: Connect) -> None:
    asked: list[str | None] = []

    def answer(request: httpx2.Request) -> httpx2.Response:
        cursor = request.url.params.get("cursor")
        asked.append(cursor)
        start = int(cursor or 0)
        page = [{"number": start + i, "input": [1.0], "output": [2.0], "demonstration": None} for i in range(2)]
        return httpx2.Response(200, json={"samples": page, "next": str(start + 2) if start < 4 else None})

    with connect(answer) as client:
        samples = client.samples("m")
        assert [next(samples).number for _ in range(3)] == [0, 1, 2]
        assert asked == [None, "2"]
        assert [sample.number for sample in samples] == [3, 4, 5]


def test_samples_are_removed(connect: Connect) -> None:
    coordinator = Script(httpx2.Response(200, json={"removed": 2}))
    with connect(coordinator) as client:
        assert client.remove_samples("m", [7, 8]) == 2
        assert client.remove_samples("m", demonstration="a b") == 2
        assert client.remove_samples("m", range(2500)) == 6
    assert [request.url.query for request in coordinator.asked[:2]] == [b"number=7&number=8", b"demonstration=a+b"]
    assert [request.url.query.count(b"number=") for request in coordinator.asked[2:]] == [1000, 1000, 500]


def test_queries_go_in_batches_and_answers_are_one(connect: Connect) -> None:
    memory = Memory()
    rows = np.arange(20_001.0)[:, np.newaxis]
    with connect(memory) as client:
        answers = client.query("m", rows, neighbours=3)
    assert len(answers) == 20_001
    assert np.array_equal(answers.outputs, 2.0 * rows)
    assert answers.samples.shape == answers.weights.shape == (20_001, 3)
    assert answers.samples[0].tolist() == [0, 1, 2]
    assert answers.demonstrations[0].tolist() == ["", "first", "second"]
    # The last batch had one neighbour only.
    assert answers.samples[-1].tolist() == [0, -1, -1]
    assert answers.distances[-1].tolist() == [0.0, np.inf, np.inf]
    assert answers.weights[-1].tolist() == [1.0, 0.0, 0.0]
    assert answers.demonstrations[-1].tolist() == ["", "", ""]
    assert memory.neighbours == 3


def test_one_query_is_a_row(connect: Connect) -> None:
    with connect(Memory()) as client:
        assert client.query("m", [4.0]).outputs.tolist() == [[8.0]]


def test_a_query_is_repeated(connect: Connect) -> None:
    coordinator = Script(httpx2.ReadError("reset"))
    with connect(coordinator) as client, pytest.raises(Unreachable):
        client.query("m", [1.0])
    assert len(coordinator.asked) == 4


@pytest.mark.parametrize("content", [b"", b"hello", b"PK\x03\x04 nonsense", b"\x93NUMPY"])
def test_an_answer_that_is_no_npz_is_noticed(connect: Connect, content: bytes) -> None:
    coordinator = Script(httpx2.Response(200, content=content))
    with connect(coordinator) as client, pytest.raises(UnexpectedAnswer, match="no coordinator of this version"):
        client.query("m", [1.0])


def test_a_module_is_trained_as_a_job(connect: Connect) -> None:
    ended = job("succeeded", "train", result=STATISTICS)

    def answer(request: httpx2.Request) -> httpx2.Response:
        if request.method == "POST":
            assert request.url.path == "/v1/modules/m/train"
            assert json.loads(request.content) == {"approximator": {"method": "nearest"}}
            return httpx2.Response(202, json=job("queued", "train"))
        if request.url.path.endswith("/events"):
            return streamed(event(1, "state", ended))
        return httpx2.Response(200, json=ended)

    with connect(answer) as client:
        assert client.train_module("m", {"method": "nearest"}).categories[0].samples == 3


def test_the_tree_is_read(connect: Connect) -> None:
    root = {"number": 0, "parent": None, "level": 0, "children": 1, "samples": 0, "point": None}
    node = {"number": 1, "parent": 0, "level": 1, "children": 0, "samples": 3, "point": [0.5]}
    tree = {"components": ["x"], "radii": [1.0], "nodes": [root, node], "truncated": False}
    coordinator = Script(httpx2.Response(200, json=tree))
    with connect(coordinator) as client:
        assert client.tree("m", [1.0, 2.0]).nodes[1].point == (0.5,)
    assert coordinator.asked[0].url.query == b"category=1.0&category=2.0"


def test_snapshots(connect: Connect) -> None:
    kept = {"name": "before", "created": "2026-11-01T10:00:00Z", "samples": 3}
    with connect(Script(httpx2.Response(200, json={"snapshots": [kept]}))) as client:
        assert client.snapshots("m")[0].name == "before"
    coordinator = Script(httpx2.Response(201, json=kept), httpx2.Response(200, json=INFO), httpx2.Response(204))
    with connect(coordinator) as client:
        assert client.take_snapshot("m", "before").samples == 3
        assert client.roll_back("m", "before").samples == 3
        client.delete_snapshot("m", "before")
    assert [(request.method, request.url.path) for request in coordinator.asked] == [
        ("POST", "/v1/modules/m/snapshots"),
        ("POST", "/v1/modules/m/snapshots/before/rollback"),
        ("DELETE", "/v1/modules/m/snapshots/before"),
    ]


def test_a_module_goes_into_a_file_and_comes_from_one(connect: Connect, tmp_path: Path) -> None:
    file = tmp_path / "m.npz"
    content = bytes(range(256)) * 10_000
    with connect(Script(httpx2.Response(200, content=content))) as client:
        client.export_module("m", file)
    assert file.read_bytes() == content
    assert file.stat().st_mode & 0o777 == 0o600
    coordinator = Script(httpx2.Response(201, json=INFO))
    with connect(coordinator) as client:
        assert client.import_module(file, "copy").samples == 3
    (request,) = coordinator.asked
    assert request.content == content
    assert request.url.query == b"name=copy"
    assert request.headers["content-length"] == str(len(content))
    assert "transfer-encoding" not in request.headers


def test_a_file_that_does_not_come_to_its_end_is_not_there(connect: Connect, tmp_path: Path) -> None:
    file = tmp_path / "m.npz"
    file.write_text("the old one")
    with connect(Script(problem(404, "not_found", "There is no module 'm'."))) as client, pytest.raises(ApiError):
        client.export_module("m", file)
    assert [each.name for each in tmp_path.iterdir()] == ["m.npz"]
    assert file.read_text() == "the old one"
