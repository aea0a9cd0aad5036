"""The table says what the estimators did."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from handeye.experiments import comparison
from handeye.experiments.baselines import Estimator
from handeye.experiments.datasets import Dataset, Problem


class Constant(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Answers with its random state, whatever it is shown."""

    def __init__(self, random_state: int | None = None) -> None:
        self.random_state = random_state

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        self.outputs_ = np.shape(y)[1]
        return self

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        return np.full((len(np.asarray(X)), self.outputs_), float(self.random_state or 0))


def draw(seed: int) -> Problem:
    """Truth is three and four off the constant, or nothing."""
    truth = np.repeat([[seed + 3.0, seed + 4.0], [float(seed), float(seed)]], [19, 1], axis=0)
    return Problem(np.zeros((5, 1)), np.zeros((5, 2)), np.zeros((20, 1)), truth)


def absent(seed: int) -> Problem:
    raise FileNotFoundError("the set is on the moon")


ESTIMATORS: dict[str, Callable[[], Estimator]] = {
    "constant": Constant,
    "in a pipeline": lambda: make_pipeline(StandardScaler(), Constant()),
}
DATASETS = {
    "here": Dataset(draw, "mm", 1e3),
    "recorded": Dataset(draw, "", 1, recorded=True),
    "away": Dataset(absent, "", 1),
}


def test_errors_are_euclidean_and_every_random_state_is_the_seed() -> None:
    scores, missing = comparison.compare(ESTIMATORS, DATASETS, [10, 20])
    assert missing == {"away": "the set is on the moon"}
    assert [(s.dataset, s.estimator, s.seed) for s in scores] == [
        (name, label, seed) for seed in (10, 20) for name in ("here", "recorded") for label in ESTIMATORS
    ]
    for score in scores[:2]:
        assert score.mean == pytest.approx(0.95 * 5000)
        assert score.rms == pytest.approx(np.sqrt(0.95) * 5000)
        assert score.p95 == pytest.approx(5000)
        assert score.fit_seconds >= 0


def test_the_results_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(comparison, "ESTIMATORS", ESTIMATORS)
    monkeypatch.setattr(comparison, "DATASETS", DATASETS)
    comparison.main(["--seeds", "10,20", "--splits", "30", "--output", str(tmp_path / "new")])
    written = json.loads((tmp_path / "new" / "comparison.json").read_text())
    assert written["absent"] == ["away"]
    assert len(written["scores"]) == 6
    assert written["scores"][0]["mean"] == pytest.approx(4750)
    table = (tmp_path / "new" / "comparison.md").read_text()
    assert "| dataset | constant | in a pipeline |" in table
    assert "| here [mm] | 4750 ± 0 | 4750 ± 0 |" in table
    assert "Seeds 10,20; 30 for recorded." in table
    assert "Left out, its data being absent: away." in table
    printed = capsys.readouterr()
    assert printed.out == table
    assert "skipped: the set is on the moon" in printed.err


def test_figures_keep_three_digits() -> None:
    def score(mean: float, seed: int) -> comparison.Score:
        return comparison.Score("set", "", "method", seed, mean, mean, mean, 0.1)

    table = comparison.markdown([score(0.01234, 1), score(0.01254, 2)], {})
    assert "| set | 0.0124 ± 0.0001 |" in table
    assert "| set | 2e-08 ± 1e-08 |" in comparison.markdown([score(1e-8, 1), score(3e-8, 2)], {})
    assert "| set | 0 ± 0 |" in comparison.markdown([score(0.0, 1)], {})


def test_wrong_seeds_are_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        comparison.main(["--seeds", "1;2", "--output", str(tmp_path)])
    assert "--seeds takes integers with commas between them, not '1;2'" in capsys.readouterr().err
