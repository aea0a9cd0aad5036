"""The Python client against the real application: modules."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from handeye.client import (
    ApiError,
    Client,
)

if TYPE_CHECKING:
    from handeye.client.models import JobEvent


DECLARATION: dict[str, Any] = {
    "name": "plane",
    "inputs": [{"name": "x", "unit": "m"}, {"name": "y", "unit": "m"}],
    "outputs": [{"name": "sum", "unit": "m"}, {"name": "difference", "unit": "m"}],
}


def taught(client: Client, count: int = 400) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Module 'plane' with `count` samples of two demonstrations; returns its inputs."""
    client.create_module(DECLARATION)
    inputs = np.random.default_rng(3).uniform(-1.0, 1.0, (count, 2))
    outputs = np.column_stack([inputs.sum(axis=1), inputs[:, 0] - inputs[:, 1]])
    numbers = client.add_samples("plane", inputs, outputs, [f"hand-{i % 2}" for i in range(count)])
    assert np.array_equal(numbers, np.arange(count))
    return inputs


def test_a_module_learns_answers_and_forgets(client: Client) -> None:
    inputs = taught(client)
    info = client.module("plane")
    assert (info.samples, info.demonstrations) == (400, 2)
    assert [module.name for module in client.modules()] == ["plane"]

    answers = client.query("plane", inputs[:50], neighbours=3)
    assert np.allclose(answers.outputs[:, 0], inputs[:50].sum(axis=1), atol=1e-3)
    assert answers.samples[:, 0].tolist() == list(range(50))
    assert answers.distances[:, 0].tolist() == [0.0] * 50
    assert answers.demonstrations[:, 0].tolist() == [f"hand-{i % 2}" for i in range(50)]
    assert (answers.support > 0.5).all()
    assert client.query("plane", [9.0, 9.0]).support[0] < 0.2
    assert client.query("plane", [0.0, 0.0], neighbours=0).samples.shape == (1, 0)

    assert client.remove_samples("plane", demonstration="hand-1") == 200
    assert client.remove_samples("plane", [0, 2, 4]) == 3
    assert client.query("plane", inputs[:1], neighbours=1).samples[0, 0] not in (0, 1)
    left = list(client.samples("plane"))
    assert [sample.number for sample in left] == list(range(6, 400, 2))
    assert left[0].demonstration == "hand-0"
    assert left[0].input == tuple(inputs[6])


def test_large_batches_go_and_come_whole(client: Client) -> None:
    client.create_module(DECLARATION)
    inputs = np.random.default_rng(4).uniform(-1.0, 1.0, (12_345, 2))
    numbers = client.add_samples("plane", inputs, -inputs)
    assert np.array_equal(numbers, np.arange(12_345))
    answers = client.query("plane", inputs, neighbours=1)
    assert np.array_equal(answers.samples[:, 0], numbers)
    assert set(answers.demonstrations[:, 0]) == {""}


def test_a_module_is_looked_into_and_trained_anew(client: Client) -> None:
    taught(client)
    statistics = client.statistics("plane")
    assert statistics.categories[0].samples == 400
    tree = client.tree("plane")
    assert tree.components == ("x", "y")
    assert tree.nodes[0].parent is None
    events: list[JobEvent] = []
    trained = client.train_module("plane", {"method": "nearest"}, timeout=30.0, on_event=events.append)
    assert trained.categories[0].samples == 400
    assert events[-1].data["state"] == "succeeded"
    approximator = client.module("plane").declaration.approximator
    assert approximator is not None
    assert approximator["method"] == "nearest"


def test_a_module_returns_to_what_it_was(client: Client) -> None:
    taught(client)
    assert client.take_snapshot("plane", "before").samples == 400
    client.remove_samples("plane", demonstration="hand-0")
    assert client.roll_back("plane", "before").samples == 400
    assert [each.name for each in client.snapshots("plane")] == ["before"]
    client.delete_snapshot("plane", "before")
    assert client.snapshots("plane") == ()


def test_a_module_goes_through_a_file(client: Client, tmp_path: Path) -> None:
    inputs = taught(client)
    client.export_module("plane", tmp_path / "plane.npz")
    with np.load(tmp_path / "plane.npz", allow_pickle=False) as arrays:
        assert np.array_equal(arrays["inputs"], inputs)
    assert client.import_module(tmp_path / "plane.npz", "copy").samples == 400
    assert np.array_equal(client.query("copy", inputs[:9]).outputs, client.query("plane", inputs[:9]).outputs)
    client.delete_module("plane")
    assert [module.name for module in client.modules()] == ["copy"]


def test_all_of_it_goes_through_a_file(client: Client, tmp_path: Path) -> None:
    inputs = taught(client)
    before = client.query("plane", inputs[:9])
    client.backup(tmp_path / "all.db")
    assert (tmp_path / "all.db").read_bytes().startswith(b"SQLite format 3\0")
    client.delete_module("plane")
    restored = client.restore(tmp_path / "all.db")
    assert (restored.modules, restored.samples) == (1, 400)
    assert np.array_equal(client.query("plane", inputs[:9]).outputs, before.outputs)
    (tmp_path / "other.db").write_bytes(b"this is no store")
    with pytest.raises(ApiError, match="cannot be restored"):
        client.restore(tmp_path / "other.db")


def test_what_does_not_fit_is_refused_with_a_sentence(client: Client) -> None:
    taught(client)
    with pytest.raises(ApiError, match="already") as refused:
        client.create_module(DECLARATION)
    assert refused.value.status == 409
    with pytest.raises(ApiError, match="3") as refused:
        client.add_samples("plane", np.zeros((1, 3)), np.zeros((1, 2)))
    assert refused.value.status == 422
    with pytest.raises(ApiError, match="no module 'sphere'"):
        client.query("sphere", [1.0])
    client.remove_samples("plane", range(400))
    with pytest.raises(ApiError) as refused:
        client.query("plane", [0.0, 0.0])
    assert (refused.value.status, refused.value.code) == (409, "not_taught")
