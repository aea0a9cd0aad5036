"""Each baseline learns what it should, and behaves as scikit-learn expects of a regressor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.utils.estimator_checks import check_estimator

from handeye.experiments.baselines import (
    BASELINES,
    BackpropRegressor,
    Estimator,
    GaussianProcess,
    KohonenRegressor,
    LocallyWeightedRegressor,
    NeuralGasRegressor,
    k_nearest_neighbours,
)

Floats = NDArray[np.float64]

SMALL: dict[str, Callable[[], Any]] = {
    "k-NN": k_nearest_neighbours,
    "LWR": LocallyWeightedRegressor,
    "Gaussian process": lambda: GaussianProcess(max_samples=60, random_state=0),
    "Kohonen map": lambda: KohonenRegressor(neurons=8, cycles=20, random_state=0),
    "neural gas": lambda: NeuralGasRegressor(neurons=8, cycles=20, random_state=0),
    "back-propagation": lambda: BackpropRegressor(hidden=5, cycles=60, learning_rate=0.02, random_state=0),
}
"""The baselines, quick enough for a test even without the compiler."""

OWN = [name for name in SMALL if name != "k-NN"]
RANDOM = ["Kohonen map", "neural gas", "back-propagation"]

LINEAR = np.array([[2.0, -1.0], [0.5, 300.0], [0.0, 0.001]])


def inputs(n: int, seed: int = 0) -> Floats:
    """Components of very different size, as pixels and radians are."""
    return np.random.default_rng(seed).uniform(-1, 1, (n, 2)) * [100, 0.1]


def linear(x: Floats) -> Floats:
    outputs: Floats = (x / [100, 0.1]) @ LINEAR.T + [0, 5, 1]
    return outputs


def curved(x: Floats) -> Floats:
    a, b = (x / [100, 0.1]).T
    return np.column_stack([np.sin(2 * a) + b, 10 * a * b])


def share_of_spread(estimator: Estimator, function: Callable[[Floats], Floats]) -> Floats:
    """Root mean squared error on fresh inputs, in standard deviations of the outputs, for each output."""
    fitted = estimator.fit(inputs(120), function(inputs(120)))
    truth = function(inputs(200, seed=1))
    answers = fitted.predict(inputs(200, seed=1))
    assert answers.shape == truth.shape
    error: Floats = np.sqrt(np.mean((answers - truth) ** 2, axis=0)) / truth.std(axis=0)
    return error


def test_every_baseline_is_tested() -> None:
    assert list(SMALL) == list(BASELINES)
    for name, make in BASELINES.items():
        assert type(make()) is type(SMALL[name]())


@pytest.mark.parametrize("name", SMALL)
def test_learns_a_linear_map(name: str) -> None:
    assert np.all(share_of_spread(SMALL[name](), linear) < (0.25 if name == "k-NN" else 0.06))


@pytest.mark.parametrize("name", SMALL)
def test_learns_a_smooth_map_better_than_the_mean(name: str) -> None:
    assert np.all(share_of_spread(SMALL[name](), curved) < 0.35)


@pytest.mark.parametrize("name", SMALL)
def test_is_repeatable(name: str) -> None:
    x, y = inputs(60), curved(inputs(60))
    answers = [SMALL[name]().fit(x, y).predict(inputs(20, seed=1)) for _ in range(2)]
    assert np.array_equal(*answers)


@pytest.mark.parametrize("name", RANDOM)
def test_the_random_state_counts(name: str) -> None:
    x, y = inputs(60), curved(inputs(60))
    answers = [SMALL[name]().set_params(random_state=seed).fit(x, y).predict(x) for seed in (1, 2)]
    assert not np.array_equal(*answers)


@pytest.mark.parametrize("name", SMALL)
def test_answers_have_the_shape_of_the_outputs(name: str) -> None:
    x, y = inputs(40), curved(inputs(40))
    flat = SMALL[name]().fit(x, y[:, 0]).predict(x[:7])
    column = SMALL[name]().fit(x, y[:, :1]).predict(x[:7])
    assert flat.shape == (7,)
    assert column.shape == (7, 1)
    assert column[:, 0] == pytest.approx(flat)


@pytest.mark.parametrize("name", SMALL)
def test_a_clone_is_unfitted_and_equal(name: str) -> None:
    original = SMALL[name]().fit(inputs(30), linear(inputs(30)))
    copy = clone(original)
    with pytest.raises(NotFittedError):
        copy.predict(inputs(3))
    copy.fit(inputs(30), linear(inputs(30)))
    assert np.array_equal(copy.predict(inputs(5, seed=1)), original.predict(inputs(5, seed=1)))


@pytest.mark.parametrize("name", SMALL)
@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        ([[0.0, np.nan], [1, 2]], [1.0, 2], "contains NaN"),
        ([[0.0, 1], [1, 2]], [1.0, np.inf], "contains infinity"),
        ([[0.0, 1], [1, 2]], [1.0, 2, 3], "inconsistent numbers of samples"),
        ([0.0, 1], [1.0, 2], "Expected 2D array, got 1D array"),
        (np.empty((0, 2)), [], "0 sample"),
    ],
)
def test_bad_samples_are_refused_in_scikit_learns_words(name: str, x: Any, y: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SMALL[name]().fit(x, y)


@pytest.mark.parametrize("name", SMALL)
def test_bad_queries_are_refused_in_scikit_learns_words(name: str) -> None:
    fitted = SMALL[name]().fit(inputs(30), linear(inputs(30)))
    with pytest.raises(ValueError, match="expecting 2 features"):
        fitted.predict([[1.0, 2, 3]])
    with pytest.raises(ValueError, match="contains NaN"):
        fitted.predict([[1.0, np.nan]])


@pytest.mark.parametrize("name", OWN)
def test_degenerate_samples_get_finite_answers(name: str) -> None:
    point = np.array([[3.0, 4.0]])
    assert SMALL[name]().fit(point, [[7.0, 8.0]]).predict(point) == pytest.approx(np.array([[7.0, 8.0]]), abs=0.1)
    same = np.repeat(point, 30, axis=0)
    assert SMALL[name]().fit(same, np.full(30, 7.0)).predict(same + 1) == pytest.approx(7, abs=0.1)
    line = np.column_stack([np.linspace(0, 1, 30), np.zeros(30)])
    answers = SMALL[name]().fit(line, line[:, 0]).predict([[0.5, 0.0], [0.5, 1.0]])
    assert answers == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize(
    ("estimator", "message"),
    [
        (KohonenRegressor(neurons=0), "neurons must be at least 1, not 0"),
        (KohonenRegressor(cycles=0), "cycles must be at least 1, not 0"),
        (NeuralGasRegressor(rates=(0.1, 0.5)), "rates must not rise"),
        (NeuralGasRegressor(rates=(1.5, 0.5)), "rates must not rise"),
        (NeuralGasRegressor(final_width=0), "final_width must be finite and above 0, not 0"),
        (BackpropRegressor(hidden=0), "hidden must be at least 1"),
        (BackpropRegressor(cycles=0), "cycles must be at least 1"),
        (BackpropRegressor(learning_rate=-1), "learning_rate must be finite and above 0"),
        (BackpropRegressor(momentum=1), r"momentum must be in \[0, 1\)"),
        (BackpropRegressor(initial_weight=np.inf), "initial_weight must be finite"),
        (LocallyWeightedRegressor(neighbours=0), "neighbours must be at least 1"),
        (LocallyWeightedRegressor(ridge=0), "ridge must be finite and at least 1e-12"),
        (GaussianProcess(max_samples=0), "max_samples must be at least 1"),
    ],
)
def test_parameters_out_of_range_are_named(estimator: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        estimator.fit(inputs(10), linear(inputs(10)))


@pytest.mark.parametrize("name", OWN)
def test_scikit_learns_own_checks(name: str) -> None:
    check_estimator(SMALL[name](), on_skip=None)


# --- What is particular to one method -------------------------------------------------------------------------------


def test_a_kohonen_lattice_has_the_inputs_dimension_and_unit_hops() -> None:
    x = np.random.default_rng(3).normal(size=(60, 5))
    flat = KohonenRegressor(neurons=9, cycles=1, random_state=0).fit(x[:, :2], x[:, 0])
    cube = KohonenRegressor(neurons=27, cycles=1, random_state=0).fit(x, x[:, 0])
    assert len(flat.references_) == 9
    assert len(cube.references_) == 27
    assert flat.hops_[0].tolist() == [0, 1, 4, 1, 2, 5, 4, 5, 8]
    assert cube.hops_.max() == 12


def test_a_kohonen_map_unfolds() -> None:
    x = np.random.default_rng(4).uniform(size=(150, 2))
    fitted = KohonenRegressor(neurons=9, cycles=30, random_state=0).fit(x, x[:, 0])
    distances = np.linalg.norm(fitted.references_[:, np.newaxis] - fitted.references_, axis=-1)
    assert distances[fitted.hops_ == 1].mean() < 0.7 * distances[fitted.hops_ > 1].mean()


def test_the_number_of_neurons_follows_the_samples() -> None:
    assert len(NeuralGasRegressor(cycles=1).fit(inputs(30), linear(inputs(30))).references_) == 10
    assert len(NeuralGasRegressor(cycles=1).fit(inputs(2), linear(inputs(2))).references_) == 1


def test_locally_weighted_regression_solves_the_weighted_least_squares() -> None:
    x, y, query = inputs(40), curved(inputs(40)), inputs(1, seed=5)
    fitted = LocallyWeightedRegressor(neighbours=12, ridge=1e-12).fit(x, y)
    scaled, at = x / x.std(axis=0), query / x.std(axis=0)
    distances = np.linalg.norm(scaled - at, axis=1)
    near = np.argsort(distances)[:12]
    weights = np.sqrt((1 - (distances[near] / (1.001 * distances[near].max())) ** 3) ** 3)[:, np.newaxis]
    terms = np.column_stack([np.ones(12), scaled[near] - at])
    solution = np.linalg.lstsq(weights * terms, weights * y[near], rcond=None)[0]
    assert fitted.predict(query)[0] == pytest.approx(solution[0], rel=1e-6)


def test_locally_weighted_regression_answers_alike_in_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    fitted = LocallyWeightedRegressor().fit(inputs(40), curved(inputs(40)))
    whole = fitted.predict(inputs(25, seed=1))
    monkeypatch.setattr("handeye.experiments.baselines.classic.BATCH", 100)
    assert fitted.predict(inputs(25, seed=1)) == pytest.approx(whole)


def test_a_gaussian_process_learns_no_more_than_it_may() -> None:
    x, y = inputs(50), curved(inputs(50))
    fitted = GaussianProcess(max_samples=20, random_state=0).fit(x, y)
    assert len(fitted.process_.X_train_) == 20
    assert len(GaussianProcess(max_samples=50, random_state=0).fit(x, y).process_.X_train_) == 50


def test_a_gaussian_process_finds_the_irrelevant_input() -> None:
    x = np.random.default_rng(6).uniform(-1, 1, (60, 2))
    fitted = GaussianProcess().fit(x, np.sin(3 * x[:, 0]))
    relevant, irrelevant = fitted.process_.kernel_.k1.k2.length_scale
    assert irrelevant > 20 * relevant


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
def test_divergence_is_an_error() -> None:
    with pytest.raises(ValueError, match="training diverged: the learning rate 50 is too high"):
        BackpropRegressor(cycles=40, learning_rate=50, random_state=0).fit(inputs(30), linear(inputs(30)))
