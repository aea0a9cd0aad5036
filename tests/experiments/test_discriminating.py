"""The experiment on discriminating features, on little."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from handeye.experiments import discriminating
from handeye.experiments.scenes import render


def test_friedmans_function_is_learned_with_at_most_three_fifths_of_the_error_of_k_nn() -> None:
    result = discriminating.idle_inputs(7)
    assert result.error <= 0.6 * result.theirs
    assert result.memory == 0


def test_a_scene_is_another_one_in_another_world_only() -> None:
    first, places = render(1, 3, shape=(48, 64))
    again, _ = render(1, 3, shape=(48, 64))
    other, same_places = render(1, 3, world=2, shape=(48, 64))
    assert first.shape == (3, 48, 64)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert np.array_equal(places, same_places)


def test_the_command_writes_its_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discriminating, "IMAGES", 30)
    monkeypatch.setattr(discriminating, "ASKED", 4)
    discriminating.main(["--seeds", "7", "--worlds", "2", "--output", str(tmp_path)])
    table = (tmp_path / "discriminating.md").read_text()
    assert "| Friedman, 30 idle inputs | 7 |" in table
    assert "| bright object in images, beside a moving one [px] | 2 |" in table
