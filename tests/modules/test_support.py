"""What a module says of how far its answers carry: support and expected errors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handeye.modules.answers import Support
from handeye.modules.module import Module
from tests.modules.toy_module import QUERY, declare, right, samples, trained


def test_support_is_one_inside_and_small_far_outside() -> None:
    module = trained()
    assert module.answer(QUERY).support == 1.0
    largest = module.statistics()[1].support.largest
    inputs = samples(1, seed=1)[0]
    corner = inputs[inputs[:, 1].argmax()]
    step = np.array([0, largest * 10.0, 0])
    far = module.answer(corner + 3 * step)
    assert far.neighbours[0].distance >= 3 * largest * 0.99
    assert far.support < 0.35
    assert far.support < module.answer(corner + 2 * step).support


def test_support_is_calibrated_by_leaving_out_whole_demonstrations() -> None:
    # Each demonstration is a tight cluster: its own samples are near, the other demonstrations are not.
    rng = np.random.default_rng(2)
    places = np.repeat([0.0, 100.0, 250.0], 10)
    inputs = np.column_stack([np.zeros(30), places + rng.uniform(-1, 1, 30), np.zeros(30)])
    module = Module(declare())
    module.train(inputs, np.zeros((30, 2)), [f"demonstration {i // 10}" for i in range(30)])
    found = module.statistics()[0].support
    assert found.median == pytest.approx(10, abs=0.3)  # 100 px at 10 px each
    assert found.largest == pytest.approx(15, abs=0.3)  # 150 px
    assert module.answer([0, 50.0, 0]).support == 1.0


def test_support_is_calibrated_for_each_category() -> None:
    module = Module(declare())
    inputs = [[s, x, 0.0] for s, reach in ((0, 10.0), (1, 1000.0)) for x in (0.0, reach)]
    module.train(inputs, np.zeros((4, 2)), ["a", "b", "a", "b"])
    assert module.answer([0, 110.0, 0]).support < 0.1
    assert module.answer([1, 500.0, 0]).support == 1.0


@given(median=st.floats(1e-3, 10), extra=st.floats(0, 10), a=st.floats(0, 100), b=st.floats(0, 100))
def test_support_falls_steadily_from_one_towards_zero(median: float, extra: float, a: float, b: float) -> None:
    support = Support(median, median + extra)
    near, far = min(a, b), max(a, b)
    assert 0 < support.of(far) <= support.of(near) <= 1
    assert support.of(median) == 1
    assert support.of(3 * (median + extra)) < 0.35


def test_support_of_a_single_demonstration_uses_its_own_samples() -> None:
    module = Module(declare())
    module.train([[0, 0.0, 0], [0, 10.0, 0], [0, 20.0, 0]], np.zeros((3, 2)), ["a"] * 3)
    assert module.statistics()[0].support == Support(1.0, 1.0)


def test_a_single_sample_supports_what_its_scales_do_not_count_as_different() -> None:
    module = Module(declare())
    module.train([[0, 0.0, 0]], [[0.0, 0.0]], ["a"])
    assert module.answer([0, 0.0, 0]).support == 1.0
    assert module.answer([0, 0.1, 0]).support > 0.9  # a hundredth of the scale away
    assert module.answer([0, 5.0, 0]).support == pytest.approx(0.5)
    assert module.answer([0, 50.0, 0]).support == pytest.approx(0.05)


def test_expected_errors_are_unknown_at_first_and_then_kept_mostly() -> None:
    module = Module(declare(method="kndb", neighbours=5))
    module.learn([[0, 1.0, 0.0]], [[0.0, 0.0]], ["a"])
    assert module.answer([0, 1.0, 0.0]).expected_error.tolist() == [np.inf, np.inf]
    module = trained(method="kndb", neighbours=5)
    asked = samples(0, 300, seed=4)[0]
    said = module.answers(asked)
    assert np.isfinite(said.expected_error).all()
    kept = np.abs(said.outputs - right(asked)) <= said.expected_error
    assert kept.mean() > 0.8  # nine of ten, of samples like those that were taught


def test_support_goes_by_what_is_taught_now() -> None:
    """The figures behind it are kept from query to query, and not a calibration longer."""
    module = Module(declare())
    places = np.repeat([0.0, 100.0], 10)
    inputs = np.column_stack([np.zeros(20), places + np.arange(20) * 0.01, np.zeros(20)])
    module.learn(inputs, np.zeros((20, 2)), ["a"] * 10 + ["b"] * 10)
    query = [0, 130.0, 0]
    assert module.answer(query).support == module.answers([query]).support[0] == 1.0  # nearer than a to b
    module.forget(range(10, 20))  # now a alone: its samples are near each other
    assert module.answer(query).support == module.answers([query]).support[0] < 0.02
    module.learn(inputs[10:], np.zeros((10, 2)), ["b"] * 10)
    assert module.answer(query).support == 1.0
    module.train(inputs[:10], np.zeros((10, 2)), ["a"] * 10)
    assert module.answer(query).support < 0.02


def test_few_demonstrations_that_are_alike_do_not_make_all_else_far() -> None:
    supports = []
    for shown in (1, 2, 4):
        module = Module(declare())
        inputs = np.column_stack([np.zeros(4), np.arange(4) * 1e-6, np.zeros(4)])
        module.learn(inputs, np.zeros((4, 2)), [str(number % shown) for number in range(4)])
        supports.append(module.answer([0, 10.0, 0]).support)  # components have a scale of 10
    assert supports == pytest.approx([0.25, 0.25 / np.sqrt(2), 0.125], rel=1e-3)
