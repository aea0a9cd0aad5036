"""Support and expected errors keep their promises, on samples whose demonstrations hang together.

Bounds leave room for chance: what is asserted is about four standard deviations from what is promised.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from handeye.rpt import Answer, Model, Settings
from tests.learner.forms import JIT_OFF

Floats = NDArray[np.float64]

PER_DEMONSTRATION = 20


def demonstrations(count: int, seed: int) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Short walks from random places; outputs with noise that grows with the first input."""
    rng = np.random.default_rng(seed)
    starts = rng.uniform(-1, 1, (count, 1, 3))
    steps = rng.normal(scale=0.02, size=(count, PER_DEMONSTRATION, 3)).cumsum(axis=1)
    inputs = (starts + steps).reshape(-1, 3)
    noise = rng.normal(size=(len(inputs), 1)) * (0.01 + 0.1 * np.abs(inputs[:, :1]))
    outputs = np.column_stack([np.sin(2 * inputs[:, :1]) + noise, inputs[:, 1:2] ** 2 + 0.3 * noise])
    return inputs, outputs, np.repeat(np.arange(count), PER_DEMONSTRATION)


def asked(model: Model, count: int, seed: int) -> tuple[Answer, Floats]:
    """Answers to demonstrations that were never shown, and what would have been right."""
    inputs, outputs, _ = demonstrations(count, seed)
    return model.answers(inputs), outputs


@pytest.fixture(scope="module")
def model() -> Model:
    taught = Model(3, 2, Settings("local_linear", neighbours=20))
    inputs, outputs, groups = demonstrations(30 if JIT_OFF else 120, seed=1)
    taught.learn(inputs, outputs, groups=groups)
    return taught


@pytest.mark.skipif(JIT_OFF, reason="needs many samples")
def test_false_alarms_are_as_rare_as_promised(model: Model) -> None:
    support = asked(model, 400, seed=2)[0].support
    for level in (0.05, 0.1, 0.2):
        # Walks, not samples, are independent: 120 of them calibrate, 400 ask.
        slack = 4 * np.sqrt(level * (1 - level) * (1 / 120 + 1 / 400))
        assert np.mean(support <= level) < level + slack
        assert np.mean(support <= level) > level - slack


@pytest.mark.skipif(JIT_OFF, reason="needs many samples")
def test_calibrated_without_groups_support_would_cry_wolf() -> None:
    inputs, outputs, _ = demonstrations(120, seed=1)
    careless = Model(3, 2, Settings("local_linear", neighbours=20))
    careless.learn(inputs, outputs)
    assert np.mean(asked(careless, 100, seed=2)[0].support <= 0.05) > 0.5


def test_queries_far_outside_are_flagged(model: Model) -> None:
    inputs = demonstrations(50, seed=3)[0]
    outside = 2.5 * inputs / np.abs(inputs).max(axis=1, keepdims=True)
    assert np.mean(model.answers(outside).support <= 0.05) > 0.95
    assert model.answer([100.0, 0, 0]).support < 0.01


def test_support_falls_as_a_query_leaves(model: Model) -> None:
    way = model.answers(np.linspace([1.0, 1.0, 1.0], [4.0, 4.0, 4.0], 30)).support
    assert np.all(np.diff(way) <= 0)
    assert 0 < way[-1] < 0.01


@pytest.mark.skipif(JIT_OFF, reason="needs many samples")
def test_nine_of_ten_errors_stay_below_the_expected_one(model: Model) -> None:
    answer, truth = asked(model, 400, seed=4)
    covered = np.mean(np.abs(answer.output - truth) <= answer.expected_error, axis=0)
    assert np.all(np.abs(covered - 0.9) < 0.06), covered


@pytest.mark.skipif(JIT_OFF, reason="needs many samples")
def test_expected_errors_know_where_the_noise_is(model: Model) -> None:
    quiet, loud = model.answers([[0.0, 0, 0], [0.9, 0, 0]]).expected_error[:, 0]
    assert loud > 2 * quiet


def test_too_few_samples_promise_nothing() -> None:
    model = Model(1, 1)
    model.learn([[0.0], [1.0], [2.0]], [[0.0], [1.0], [2.0]])
    assert model.answer([0.5]).expected_error.tolist() == [np.inf]
    assert model.answer([50.0]).support == 1 / 4
    alone = Model(1, 1)
    alone.learn([[0.0]], [[0.0]])
    assert alone.answer([0.0]).support == 1
    assert alone.answer([0.1]).support == 0.5


def test_a_single_group_is_calibrated_sample_by_sample() -> None:
    one, none = Model(3, 2), Model(3, 2)
    inputs, outputs, _ = demonstrations(2, seed=5)
    one.learn(inputs, outputs, groups=np.zeros(len(inputs), int))
    none.learn(inputs, outputs)
    queries = demonstrations(2, seed=6)[0]
    assert np.array_equal(one.answers(queries).support, none.answers(queries).support)


def test_calibration_keeps_up_with_learning() -> None:
    inputs, outputs, groups = demonstrations(4 if JIT_OFF else 20, seed=7)
    grown, whole = Model(3, 2), Model(3, 2)
    half = len(inputs) // 2
    grown.learn(inputs[:half], outputs[:half], groups=groups[:half])
    grown.learn(inputs[half:], outputs[half:], groups=groups[half:])
    whole.learn(inputs, outputs, groups=groups)
    assert np.array_equal(grown.calibration().scores, whole.calibration().scores)
