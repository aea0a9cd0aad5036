"""The experiment on trust, on lessons small enough to know what must come out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from handeye.experiments import trust


def lesson(shift: float = 0.0) -> trust.Lesson:
    rng = np.random.default_rng(1)
    inputs, asked = rng.uniform(-1, 1, (300, 2)), rng.uniform(-1, 1, (200, 2)) + shift
    return trust.Lesson(inputs, inputs[:, :1], None, asked, asked[:, :1], np.ones(2), ())


def test_ordinary_queries_are_rarely_flagged_and_outside_ones_are() -> None:
    record = trust.judge("square", lesson(), 1)
    assert record.false_alarms[0] <= record.false_alarms[1] <= record.false_alarms[2] < 0.25
    assert min(record.power) > 0.95
    assert trust.judge("elsewhere", lesson(shift=5.0), 1).false_alarms[0] == 1


def test_stretched_queries_lie_outside_in_every_category() -> None:
    taught = trust.grasp(1)
    for stretch in trust.STRETCHES:
        moved = trust.stretched(taught, stretch)
        assert np.array_equal(moved[:, 0], taught.asked_inputs[:, 0])
        near = taught.inputs[taught.inputs[:, 0] == 0][:, 1:] / taught.scales[1:]
        far = moved[moved[:, 0] == 0][:, 1:] / taught.scales[1:]
        middle = near.mean(axis=0)
        ways = (far - middle) / np.linalg.norm(far - middle, axis=1, keepdims=True)
        assert np.linalg.norm(far - middle, axis=1) == pytest.approx(stretch * ((near - middle) @ ways.T).max(axis=0))


def test_demonstrations_are_taught_or_asked_as_a_whole() -> None:
    taught = trust.grasp(3)
    assert taught.groups is not None
    assert len(np.unique(taught.groups)) == 20
    assert len(taught.inputs) + len(taught.asked_inputs) == 1020


def test_the_command_writes_its_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trust, "DATASETS", {"square": lambda _seed: lesson()})
    trust.main(["--seeds", "1,2", "--output", str(tmp_path)])
    assert "| square | 300 | 200 |" in (tmp_path / "trust.md").read_text()
