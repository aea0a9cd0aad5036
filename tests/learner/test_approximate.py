"""KNDB, KNDB2 and the local polynomials."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handeye import rpt
from handeye.rpt import approximate
from tests.learner import reference
from tests.learner.forms import Floats, examples


@st.composite
def neighbourhoods(draw: st.DrawFn) -> tuple[Floats, Floats, Floats, Floats]:
    """(query, inputs, outputs, distances), nearest first; at times coincident, degenerate or at the query."""
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    k, d, p = draw(st.integers(1, 12)), draw(st.integers(1, 4)), draw(st.integers(1, 3))
    inputs = rng.normal(size=(k, d)) * draw(st.sampled_from([1e-3, 1.0, 1e3]))
    if draw(st.booleans()):
        inputs = np.round(inputs)
    query = inputs[0].copy() if draw(st.booleans()) else rng.normal(size=d)
    distances = np.linalg.norm(inputs - query, axis=1)
    order = np.argsort(distances, kind="stable")
    return query, inputs[order], rng.normal(size=(k, p)), distances[order]


def linear_problem(k: int = 20, d: int = 3, p: int = 2) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
    """(query, inputs, outputs, distances, matrix, right answer) of a linear function."""
    rng = np.random.default_rng(8)
    matrix, constant = rng.normal(size=(p, d)), rng.normal(size=p)
    query = rng.normal(size=d)
    inputs = rng.normal(size=(k, d))
    distances = np.linalg.norm(inputs - query, axis=1)
    inputs, distances = inputs[np.argsort(distances)], np.sort(distances)
    return query, inputs, inputs @ matrix.T + constant, distances, matrix, matrix @ query + constant


# --- KNDB -----------------------------------------------------------------------------------------------------------


def test_kndb_weights_are_those_of_the_thesis() -> None:
    distances, alpha, epsilon = [0.5, 1.0, 1.5], 3.0, 0.01
    raw = [1 / alpha ** (distance / (epsilon + 0.5)) for distance in distances]
    expected = [weight / sum(raw) for weight in raw]
    assert approximate.kndb_weights(distances, alpha=alpha, epsilon=epsilon) == pytest.approx(expected)


@given(neighbourhood=neighbourhoods(), alpha=st.floats(1, 1e6))
@examples(100)
def test_kndb_is_a_mean_of_its_neighbours(neighbourhood: tuple[Floats, ...], alpha: float) -> None:
    _, _, outputs, distances = neighbourhood
    weights = approximate.kndb_weights(distances, alpha=alpha)
    assert weights.sum() == pytest.approx(1)
    assert np.all(weights >= 0)
    assert np.all(np.diff(weights) <= 0)
    answer = approximate.kndb(outputs, distances, alpha=alpha)
    assert np.all(answer >= outputs.min(axis=0) - 1e-9)
    assert np.all(answer <= outputs.max(axis=0) + 1e-9)


def test_kndb_is_exact_at_a_sample() -> None:
    outputs = np.array([[1.0, 2.0], [5.0, -1.0], [7.0, 7.0]])
    assert approximate.kndb(outputs, [0.0, 0.1, 0.2], alpha=3.0).tolist() == [1.0, 2.0]


def test_a_large_alpha_leaves_the_decision_to_the_nearest() -> None:
    outputs = np.array([[1.0], [5.0], [7.0]])
    assert approximate.kndb(outputs, [0.1, 0.2, 0.3], alpha=1e12) == pytest.approx(1.0, abs=1e-9)
    assert approximate.kndb(outputs, [0.1, 0.2, 0.3], alpha=1.0) == pytest.approx(13 / 3)


def test_coincident_neighbours_share_the_decision() -> None:
    assert approximate.kndb([[1.0], [3.0], [9.0]], [0.0, 0.0, 1.0], alpha=3.0) == pytest.approx(2.0)


def test_nearest_is_the_first() -> None:
    assert approximate.nearest([[1.0, 2.0], [3.0, 4.0]]).tolist() == [1.0, 2.0]


# --- KNDB2 ----------------------------------------------------------------------------------------------------------


def test_kndb2_is_exact_on_linear_functions() -> None:
    query, inputs, outputs, distances, matrix, right = linear_problem()
    gradients = np.broadcast_to(matrix, (len(inputs), *matrix.shape))
    answer = approximate.kndb2(query, inputs, outputs, gradients, distances, alpha=3.0)
    assert answer == pytest.approx(right)


@given(neighbourhood=neighbourhoods())
@examples(100)
def test_kndb2_without_slopes_is_kndb(neighbourhood: tuple[Floats, ...]) -> None:
    query, inputs, outputs, distances = neighbourhood
    flat = np.zeros((len(inputs), outputs.shape[1], inputs.shape[1]))
    answer = approximate.kndb2(query, inputs, outputs, flat, distances, alpha=2.0)
    assert np.array_equal(answer, approximate.kndb(outputs, distances, alpha=2.0))


def test_gradients_of_a_linear_function_are_its_matrix() -> None:
    _, inputs, outputs, _, matrix, _ = linear_problem(k=40)
    found = approximate.estimate_gradients(rpt.build(inputs), outputs, neighbours=10, smoothing=0.1, ridge=1e-10)
    assert found.shape == (40, 2, 3)
    assert np.allclose(found, matrix, atol=1e-6)


def test_gradients_where_inputs_do_not_vary_are_zero() -> None:
    inputs = np.column_stack([np.linspace(0, 1, 20), np.zeros(20)])
    found = approximate.estimate_gradients(
        rpt.build(inputs), 3 * inputs[:, :1], neighbours=5, smoothing=0.1, ridge=1e-8
    )
    assert np.allclose(found[:, 0], [3.0, 0.0], atol=1e-5)


def test_gradients_of_coincident_samples_are_zero() -> None:
    found = approximate.estimate_gradients(
        rpt.build(np.ones((4, 2))), [[1.0], [2.0], [3.0], [4.0]], neighbours=9, smoothing=0.1, ridge=1e-6
    )
    assert np.array_equal(found, np.zeros((4, 1, 2)))


def test_kndb2_beats_kndb_on_a_smooth_function() -> None:
    rng = np.random.default_rng(9)
    inputs = rng.uniform(-1, 1, size=(300, 2))

    def function(x: Floats) -> Floats:
        return np.column_stack([np.sin(2 * x[:, 0]) * x[:, 1], x[:, 0] ** 2 + x[:, 1]])

    outputs, queries = function(inputs), rng.uniform(-0.9, 0.9, size=(50, 2))
    tree = rpt.build(inputs)
    gradients = approximate.estimate_gradients(tree, outputs, neighbours=10, smoothing=0.1, ridge=1e-6)
    ids, distances = tree.exact(queries, 5)
    plain = [approximate.kndb(outputs[i], d, alpha=3.0) for i, d in zip(ids, distances, strict=True)]
    second = [
        approximate.kndb2(q, inputs[i], outputs[i], gradients[i], d, alpha=3.0)
        for q, i, d in zip(queries, ids, distances, strict=True)
    ]
    right = function(queries)
    assert np.abs(np.array(second) - right).mean() < 0.25 * np.abs(np.array(plain) - right).mean()


# --- local polynomials ----------------------------------------------------------------------------------------------


@given(neighbourhood=neighbourhoods(), smoothing=st.floats(1e-3, 10))
@examples(100)
def test_local_weights_fall_with_the_distance(neighbourhood: tuple[Floats, ...], smoothing: float) -> None:
    weights = approximate.local_weights(neighbourhood[3], smoothing=smoothing)
    assert weights.sum() == pytest.approx(1)
    assert np.all(weights > 0)
    assert np.all(np.diff(weights) <= 0)


def test_local_weights_are_as_said() -> None:
    weights = approximate.local_weights([1.0, 2.0], smoothing=0.5)
    assert weights[0] / weights[1] == pytest.approx((2**2 + 1) / (1**2 + 1))


def test_local_linear_is_exact_on_linear_functions() -> None:
    query, inputs, outputs, distances, _, right = linear_problem()
    weights = approximate.local_weights(distances, smoothing=0.1)
    assert approximate.local_linear(query, inputs, outputs, weights, ridge=1e-10) == pytest.approx(right)
    # Also far outside of its neighbours.
    far = inputs[:1] + np.array([[30.0, 0.0, 0.0]])
    matrix = np.linalg.lstsq(np.column_stack([inputs, np.ones(len(inputs))]), outputs, rcond=None)[0]
    answer = approximate.local_linear(far[0], inputs, outputs, weights, ridge=1e-10)
    assert answer == pytest.approx(np.append(far[0], 1) @ matrix, abs=1e-5)


def test_local_quadratic_is_exact_on_quadratic_functions() -> None:
    rng = np.random.default_rng(10)
    inputs, query = rng.normal(size=(30, 3)), rng.normal(size=3)

    def function(x: Floats) -> Floats:
        return np.array([1 + x[0] - 2 * x[1] * x[2] + x[2] ** 2, x[0] * x[1] - 3 * x[1]])

    outputs = np.array([function(x) for x in inputs])
    answer = approximate.local_quadratic(query, inputs, outputs, np.ones(30), ridge=1e-11, curvature_ridge=1e-11)
    assert answer == pytest.approx(function(query), abs=1e-6)


def reference_fit(
    query: Floats, inputs: Floats, outputs: Floats, weights: Floats, ridge: float, curvature: float | None
) -> Floats:
    """Ridge regression by stacked least squares, terms written out."""
    share = weights / weights.sum()
    middle = share @ inputs
    spread = math.sqrt(float(share @ ((inputs - middle) ** 2).mean(axis=1)))

    def terms(x: Floats) -> list[float]:
        z = ((x - middle) / spread).tolist()
        products = [a * b * (1 if i == j else math.sqrt(2)) for i, a in enumerate(z) for j, b in enumerate(z) if j >= i]
        return [1.0, *z, *(products if curvature is not None else [])]

    design = np.array([terms(x) for x in inputs])
    d = inputs.shape[1]
    penalty = np.sqrt([0.0] + [ridge] * d + [curvature or 0.0] * (design.shape[1] - 1 - d))
    root = np.sqrt(share)[:, np.newaxis]
    stacked = np.concatenate([design * root, np.diag(penalty)])
    right = np.concatenate([outputs * root, np.zeros((len(penalty), outputs.shape[1]))])
    return np.asarray(terms(query) @ np.linalg.lstsq(stacked, right, rcond=None)[0])


@given(seed=st.integers(0, 10**6), k=st.integers(2, 30), d=st.integers(1, 4), ridge=st.floats(1e-3, 1))
@examples(100)
def test_local_fits_are_ridge_regression(seed: int, k: int, d: int, ridge: float) -> None:
    rng = np.random.default_rng(seed)
    query, inputs, outputs = rng.normal(size=d), rng.normal(size=(k, d)), rng.normal(size=(k, 2))
    weights = rng.uniform(0.1, 1, size=k)
    linear = approximate.local_linear(query, inputs, outputs, weights, ridge=ridge)
    assert linear == pytest.approx(reference_fit(query, inputs, outputs, weights, ridge, None), abs=1e-7)
    quadratic = approximate.local_quadratic(query, inputs, outputs, weights, ridge=ridge, curvature_ridge=2 * ridge)
    assert quadratic == pytest.approx(reference_fit(query, inputs, outputs, weights, ridge, 2 * ridge), abs=1e-7)


def fits(query: Floats, inputs: Floats, outputs: Floats, weights: Floats) -> list[Floats]:
    return [
        approximate.local_linear(query, inputs, outputs, weights, ridge=1e-3),
        approximate.local_quadratic(query, inputs, outputs, weights, ridge=1e-3, curvature_ridge=1e-2),
    ]


@given(neighbourhood=neighbourhoods())
@examples(100)
def test_local_fits_are_finite_and_meet_constants(neighbourhood: tuple[Floats, ...]) -> None:
    query, inputs, outputs, distances = neighbourhood
    weights = approximate.local_weights(distances, smoothing=0.1)
    for answer in fits(query, inputs, outputs, weights):
        assert np.all(np.isfinite(answer))
    for answer in fits(query, inputs, np.full_like(outputs, 2.5), weights):
        assert answer == pytest.approx(2.5)


def test_degenerate_neighbours_do_not_give_wild_values() -> None:
    # All on a line, with noise of 1e-9 across it: the slope across is not determined by these samples.
    along = np.linspace(-1, 1, 15)
    inputs = np.column_stack([along, 1e-9 * np.sin(40 * along)])
    outputs = np.sin(7 * along)[:, np.newaxis]
    for answer in fits(np.array([0.0, 1.0]), inputs, outputs, np.ones(15)):
        assert abs(answer[0]) < 3


def test_coincident_neighbours_give_their_weighted_mean() -> None:
    for answer in fits(np.array([3.0]), np.ones((2, 1)), np.array([[1.0], [2.0]]), np.array([3.0, 1.0])):
        assert answer == pytest.approx(1.25)


def test_a_fit_does_not_depend_on_the_inputs_unit_or_rotation() -> None:
    rng = np.random.default_rng(11)
    query, inputs, outputs = rng.normal(size=2), rng.normal(size=(12, 2)), rng.normal(size=(12, 1))
    turn = 1000 * np.array([[0.8, -0.6], [0.6, 0.8]])
    before = fits(query, inputs, outputs, np.ones(12))
    after = fits(turn @ query, inputs @ turn.T, outputs, np.ones(12))
    assert np.allclose(before, after)


# --- leaf maps --------------------------------------------------------------------------------------------------------


@given(seed=st.integers(0, 10**6), d=st.integers(1, 5), p=st.integers(1, 3), radius=st.sampled_from([1e-6, 1.0, 1e3]))
@examples(100)
def test_leaf_maps_are_those_of_the_thesis(seed: int, d: int, p: int, radius: float) -> None:
    rng = np.random.default_rng(seed)
    sample, matrix, bend = rng.normal(size=d), rng.normal(size=(p, d)), rng.normal(size=(p, d, d))

    def teacher(inputs: Floats) -> Floats:
        steps = (inputs - sample) / radius
        return np.asarray(steps @ matrix.T + np.einsum("na,pab,nb->np", steps, bend, steps))

    derived = reference.derived_points(sample.tolist(), radius)
    found = approximate.leaf_map(sample, teacher(sample[np.newaxis])[0], derived, teacher(derived))
    assert np.allclose(found * radius, reference.leaf_map(teacher, sample.tolist(), radius) * radius, atol=1e-6)


def test_a_leaf_map_from_any_points_is_least_squares_through_the_sample() -> None:
    rng = np.random.default_rng(12)
    sample, output = rng.normal(size=3), rng.normal(size=2)
    inputs, outputs = sample + rng.normal(size=(9, 3)), rng.normal(size=(9, 2))
    expected = np.linalg.lstsq(inputs - sample, outputs - output, rcond=None)[0].T
    assert np.allclose(approximate.leaf_map(sample, output, inputs, outputs), expected, atol=1e-6)


def test_a_direction_without_a_derived_point_gets_no_slope() -> None:
    derived = [[1.0, 0.0], [-1.0, 0.0]]
    assert np.allclose(approximate.leaf_map([0.0, 0.0], [1.0], derived, [[4.0], [-2.0]]), [[3.0, 0.0]])
    assert approximate.leaf_map([1.0, 1.0], [0.0], np.ones((3, 2)), np.ones((3, 1))).tolist() == [[0.0, 0.0]]


# --- errors ---------------------------------------------------------------------------------------------------------


def test_bad_parameters_are_errors() -> None:
    one = np.ones((1, 1))
    with pytest.raises(ValueError, match="alpha >= 1"):
        approximate.kndb_weights([1.0], alpha=0.5)
    with pytest.raises(ValueError, match="epsilon > 0"):
        approximate.kndb_weights([1.0], alpha=2, epsilon=0)
    with pytest.raises(ValueError, match="nearest first"):
        approximate.kndb_weights([2.0, 1.0], alpha=2)
    with pytest.raises(ValueError, match="nearest first"):
        approximate.local_weights([-1.0], smoothing=0.1)
    with pytest.raises(ValueError, match="nearest first"):
        approximate.local_weights([], smoothing=0.1)
    with pytest.raises(ValueError, match="smoothing"):
        approximate.local_weights([1.0], smoothing=0)
    with pytest.raises(ValueError, match="ridge"):
        approximate.local_linear([0.0], one, one, [1.0], ridge=0)
    with pytest.raises(ValueError, match="ridge"):
        approximate.local_quadratic([0.0], one, one, [1.0], ridge=1, curvature_ridge=math.nan)
    with pytest.raises(ValueError, match="not all zero"):
        approximate.local_linear([0.0], one, one, [0.0], ridge=1)
    with pytest.raises(ValueError, match="shapes do not fit"):
        approximate.local_linear([0.0, 0.0], one, one, [1.0], ridge=1)
    with pytest.raises(ValueError, match="at least one row"):
        approximate.nearest(np.zeros((0, 2)))
    with pytest.raises(ValueError, match="shapes do not fit"):
        approximate.leaf_map([0.0, 0.0], [0.0], one, one)
    with pytest.raises(ValueError, match="shapes do not fit"):
        approximate.leaf_map([0.0], [0.0], one, np.ones((2, 1)))
    with pytest.raises(ValueError, match="ridge"):
        approximate.leaf_map([0.0], [0.0], one, one, ridge=0)


def test_gradients_need_every_sample_and_its_output() -> None:
    inputs = [[0.0], [0.1], [5.0]]
    outputs = [[0.0], [1.0], [2.0]]
    dropping = rpt.build(inputs, radii=[1.0], keep_covered=False)
    for tree, values in ((dropping, outputs), (rpt.build(inputs), outputs[:2])):
        with pytest.raises(ValueError, match="keeps every sample"):
            approximate.estimate_gradients(tree, values, neighbours=2, smoothing=0.1, ridge=1e-3)
