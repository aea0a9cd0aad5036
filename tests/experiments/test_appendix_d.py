"""Appendix D's experiments, made small."""

from __future__ import annotations

import pytest

from handeye.experiments import appendix_d
from handeye.experiments.appendix_d import EXPERIMENTS, Experiment
from handeye.experiments.datasets import paraboloid

SMALL = Experiment("1", "x² + 2.3 y²", paraboloid, 0, 1, 5, 60, 3, (0.0048, 0.0048))

VARIANCE = (1 + 2.3**2) * 4 / 45
"""Of x² + 2.3 y² over the unit square."""


def test_the_table_stands_beside_the_thesis(capsys: pytest.CaptureFixture[str]) -> None:
    outcomes = appendix_d.appendix_d([SMALL], seed=1)
    (outcome,) = outcomes
    assert len(outcome.training) == len(outcome.grid) == SMALL.trials
    assert len(set(outcome.training)) == SMALL.trials, "the trials' first weights must differ"
    assert max(outcome.training) < VARIANCE / 2
    printed = capsys.readouterr().out
    assert printed == appendix_d.markdown(outcomes)
    assert "| 1 | x² + 2.3 y² | 0 … 1 | 5 | 60 | 3 | 0.0048 |" in printed
    assert f"| {min(outcome.grid):.4f}–{max(outcome.grid):.4f} |" in printed


def test_a_trial_is_repeatable() -> None:
    assert appendix_d.run_trial(SMALL, 1, 2) == appendix_d.run_trial(SMALL, 1, 2)


def test_there_are_six_experiments() -> None:
    assert list(dict.fromkeys(each.number[0] for each in EXPERIMENTS)) == list("123456")
    assert all(best <= worst for best, worst in (each.thesis for each in EXPERIMENTS))
