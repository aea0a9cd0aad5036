"""What several answers amount to."""

from __future__ import annotations

import numpy as np
import pytest

from handeye.server.goals import Goals

HERE = np.zeros(6)


def turn(first: float) -> np.ndarray:
    return np.array([first, 0.0, 0.0, 0.0, 0.0, 0.0])


def test_one_answer_is_the_goal() -> None:
    assert Goals(0.01).mean(HERE + 1.0, turn(0.3)) == pytest.approx(np.array([1.3, 1, 1, 1, 1, 1]))


def test_answers_that_differ_by_noise_are_averaged_those_that_go_far_weighing_less() -> None:
    goals = Goals(0.01)
    goals.mean(HERE, turn(0.04))
    mean = goals.mean(turn(0.03), turn(0.002))  # says 0.032, from near
    assert 0.032 < mean[0] < 0.0336
    assert goals.mean(turn(0.032), turn(0.0))[0] == pytest.approx(0.032, abs=4e-4)


def test_an_answer_that_says_something_else_stands_alone() -> None:
    goals = Goals(0.01)
    goals.mean(HERE, turn(0.04))
    assert goals.mean(HERE, turn(0.06))[0] == pytest.approx(0.06)
    assert goals.mean(HERE, turn(0.062))[0] == pytest.approx(0.061, abs=1e-4)


def test_another_subtask_knows_nothing_of_the_one_before() -> None:
    goals = Goals(0.01)
    goals.mean(HERE, turn(0.04))
    goals.forget()
    assert goals.mean(HERE, turn(0.045))[0] == 0.045


def test_without_noise_exact_answers_count() -> None:
    assert Goals(0.0).mean(HERE, turn(0.0)) == pytest.approx(HERE)
