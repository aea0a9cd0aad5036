"""Radii derived from the data: what `derive_radii` promises."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from handeye import rpt
from handeye.rpt.radii import FAN_OUT, LEAF
from tests.learner.examples import adversarial
from tests.learner.forms import JIT_OFF, Floats, examples

N = 400 if JIT_OFF else 40_000


def spreads(d: int) -> dict[str, Floats]:
    rng = np.random.default_rng(2)
    return {
        "uniform": rng.uniform(size=(N, d)),
        "normal": rng.normal(size=(N, d)),
        "clusters": rng.normal(size=(30, d))[rng.integers(0, 30, N)] * 10 + rng.normal(size=(N, d)),
        "manifold": np.sin(rng.uniform(size=(N, 2)) @ rng.normal(size=(2, d))),
        "walk": np.cumsum(rng.normal(size=(N, d)), axis=0),
        "few places": rng.integers(0, 3, size=(N, d)).astype(np.float64),
    }


@pytest.mark.parametrize("d", [1, 3, 12] if JIT_OFF else [1, 2, 3, 6, 12, 30])
@pytest.mark.parametrize("case", spreads(1))
def test_the_fan_out_is_bounded_in_any_dimension(case: str, d: int) -> None:
    points = spreads(d)[case]
    tree = rpt.build(points)
    figures = tree.statistics()
    # About twice as many in low dimension; in high dimension many samples are tails.
    assert figures.widest <= (2 if d <= 3 else 6) * FAN_OUT
    # And they do divide: where samples differ there is more than one node.
    assert figures.nodes >= min(FAN_OUT, len(np.unique(points, axis=0))) / 3


@pytest.mark.skipif(JIT_OFF, reason="too long without the compiler")
def test_the_fan_out_is_bounded_where_regions_differ() -> None:
    # Half of the samples lie on a line, half in a ball of the same size: what suits the line would be too fine there.
    rng = np.random.default_rng(5)
    half = LEAF * FAN_OUT
    line = np.column_stack([rng.uniform(-1, 1, half), np.full(half, 5.0), np.zeros(half)])
    points = np.concatenate([line, rng.uniform(-1, 1, size=(half, 3))])
    for order in (slice(None), slice(None, None, -1), rng.permutation(2 * half)):
        tree = rpt.build(points[order])
        assert len(tree.radii) == 2
        assert tree.statistics().widest <= 2 * FAN_OUT


@pytest.mark.parametrize("fan_out", [2, 4, 10])
def test_the_fan_out_can_be_chosen(fan_out: int) -> None:
    points = np.random.default_rng(3).normal(size=(2000, 3))
    child_count = rpt.build(points, radii=rpt.derive_radii(points, fan_out=fan_out)).nodes().child_count
    assert fan_out / 2 <= child_count[0] <= 2 * fan_out


@pytest.mark.parametrize(("n", "levels"), [(10, 1), (LEAF * FAN_OUT, 1), (LEAF * FAN_OUT + 1, 2)])
def test_there_are_as_many_levels_as_it_takes(n: int, levels: int) -> None:
    points = np.random.default_rng(4).uniform(size=(n, 2))
    assert len(rpt.derive_radii(points)) == levels


@given(
    points=arrays.arrays(
        np.float64,
        st.tuples(st.integers(1, 40), st.integers(1, 3)),
        elements=st.one_of(st.integers(-3, 3).map(float), st.floats(-1e150, 1e150), st.floats(-1e-150, 1e-150)),
    ),
    fan_out=st.integers(2, 40),
)
@examples(200)
def test_radii_fit_any_samples(points: Floats, fan_out: int) -> None:
    radii = rpt.derive_radii(points, fan_out=fan_out)
    assert len(radii) == 1
    assert 0 <= radii[0] < np.inf
    assert np.array_equal(radii, rpt.derive_radii(points, fan_out=fan_out))
    assert rpt.build(points, radii=radii).statistics().widest <= fan_out


@pytest.mark.parametrize("case", adversarial())
def test_radii_of_adversarial_inputs_decrease(case: str) -> None:
    points = np.tile(adversarial()[case], (4 if JIT_OFF else 60, 1))
    radii = rpt.derive_radii(points, fan_out=2)
    assert np.all(np.diff(radii) < 0)
    assert radii[-1] >= 0
    rpt.build(points, radii=radii)


def test_radii_are_a_matter_of_the_samples_alone() -> None:
    points = np.random.default_rng(5).normal(size=(5000, 3))
    np.random.seed(1)  # noqa: NPY002 - whatever the state of the global generator
    first = rpt.derive_radii(points)
    np.random.seed(2)  # noqa: NPY002
    assert np.array_equal(first, rpt.derive_radii(points))
    assert np.array_equal(first, rpt.derive_radii(np.asfortranarray(points)))
    assert np.array_equal(first, rpt.build(points).radii)


def test_radii_scale_with_the_data() -> None:
    points = np.random.default_rng(2).normal(size=(5000, 3))
    # A power of two changes no digit.
    assert np.array_equal(rpt.derive_radii(points * 8), rpt.derive_radii(points) * 8)


def test_coincident_samples_need_no_radius() -> None:
    assert rpt.derive_radii(np.ones((5, 2))).tolist() == [0.0]
    assert rpt.derive_radii(np.ones((5000, 2))).tolist() == [0.0]
    assert rpt.derive_radii([[1.0]]).tolist() == [0.0]
    assert rpt.derive_radii([7.0]).tolist() == [0.0]


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        (np.zeros((0, 3)), "non-empty"),
        (np.zeros((2, 2, 2)), "non-empty"),
        ([[np.nan]], "finite"),
        ([[np.inf], [0.0]], "finite"),
        ([[1j]], "real numbers"),
        ([["a"]], "could not convert"),
    ],
)
def test_bad_input_is_an_error(inputs: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rpt.derive_radii(inputs)


@pytest.mark.parametrize("fan_out", [1, 0, -1])
def test_fan_out_below_two_is_an_error(fan_out: int) -> None:
    with pytest.raises(ValueError, match=f"fan_out must be at least 2, not {fan_out}"):
        rpt.derive_radii([[0.0], [1.0]], fan_out=fan_out)
