"""The scikit-learn estimator: scikit-learn's own checks, choices from the data, bad input, incremental learning."""

from __future__ import annotations

import pickle
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.model_selection import GridSearchCV, KFold
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.estimator_checks import parametrize_with_checks

from handeye import rpt
from handeye.rpt.estimator import RPTRegressor
from tests.learner.forms import JIT_OFF, examples

Floats = NDArray[np.float64]


def shape(inputs: Floats) -> Floats:
    """A smooth map of the first two of its inputs to two outputs."""
    return np.column_stack([np.sin(2 * inputs[:, 0]) + inputs[:, 1] ** 2, inputs[:, 0] * inputs[:, 1]])


def taught(n: int, d: int = 2, seed: int = 0) -> tuple[Floats, Floats]:
    inputs = np.random.default_rng(seed).uniform(-1, 1, (n, d))
    return inputs, shape(inputs)


N = 40 if JIT_OFF else 300


@pytest.mark.skipif(JIT_OFF, reason="takes minutes without compilation")
@parametrize_with_checks([RPTRegressor(), RPTRegressor("kndb2", neighbours=5)])  # type: ignore[untyped-decorator]
def test_scikit_learn_is_content(estimator: BaseEstimator, check: Any) -> None:
    check(estimator)


def test_it_says_what_it_chose() -> None:
    inputs, outputs = taught(N)
    regressor = RPTRegressor().fit(inputs, outputs)
    best = regressor.selection_.trials[0]
    assert regressor.settings_ == best.settings == regressor.model_.settings
    assert best.error == min(trial.error for trial in regressor.selection_.trials) < 0.1
    table = str(regressor.selection_).splitlines()
    assert table[0].split() == ["error", "scaling", "method", "neighbours", "smoothing", "ridges"]
    assert len(table) == 1 + len(regressor.selection_.trials)
    assert best.settings.method in table[1]
    queries = inputs[:5] + 0.01
    answer = regressor.explain(queries)
    assert np.array_equal(answer.output, regressor.predict(queries))
    assert np.array_equal(answer.support, regressor.support(queries))
    assert answer.gradient.shape == (5, 2, 2)
    assert np.all(regressor.support(queries) > 0.05)
    assert regressor.support(np.full((1, 2), 50.0)) < 2 / N


@pytest.mark.skipif(JIT_OFF, reason="needs many samples")
def test_smooth_maps_get_local_quadratics_and_steps_do_not() -> None:
    inputs, outputs = taught(400)
    assert RPTRegressor().fit(inputs, outputs).settings_.method == "local_quadratic"
    steps = np.floor(3 * inputs[:, 0]) + np.floor(3 * inputs[:, 1])
    assert RPTRegressor().fit(inputs, steps).settings_.method != "local_quadratic"
    line = RPTRegressor().fit(inputs, inputs @ [1.0, 2.0] + np.random.default_rng(1).normal(0, 0.5, 400))
    assert line.settings_.method == "local_linear"
    assert line.settings_.neighbours is not None
    assert line.settings_.neighbours >= 30


@pytest.mark.skipif(JIT_OFF, reason="needs many samples")
def test_inputs_that_mean_nothing_hardly_count() -> None:
    inputs, outputs = taught(600, d=8)
    regressor = RPTRegressor().fit(inputs, outputs)
    assert np.max(regressor.scales_[:2]) < 0.3 * np.min(regressor.scales_[2:])
    plain = RPTRegressor(scales=np.ones(8)).fit(inputs, outputs)
    test, truth = taught(300, d=8, seed=1)
    errors = [float(np.abs(r.predict(test) - truth).mean()) for r in (regressor, plain)]
    assert errors[0] < 0.8 * errors[1]


def test_units_do_not_matter() -> None:
    inputs, outputs = taught(N)
    units = np.array([1e6, 1e-6])
    queries = inputs[:20] + 0.01
    small = RPTRegressor().fit(inputs, outputs).predict(queries)
    large = RPTRegressor().fit(inputs * units, outputs * 1e3).predict(queries * units)
    assert large == pytest.approx(1e3 * small, rel=1e-3, abs=1e-3)


def test_what_the_user_fixes_stays() -> None:
    inputs, outputs = taught(40)
    regressor = RPTRegressor("kndb", neighbours=7, scales=[2.0, 3.0]).fit(inputs, outputs)
    assert (regressor.settings_.method, regressor.settings_.neighbours) == ("kndb", 7)
    assert regressor.scales_.tolist() == [2, 3]
    for method in rpt.settings.METHODS:
        assert RPTRegressor(method).fit(inputs, outputs).settings_.method == method
    assert RPTRegressor(smoothing=0.7).fit(inputs, outputs).settings_.smoothing == 0.7


@pytest.mark.parametrize(
    ("parameters", "sentence"),
    [
        ({"method": "magic"}, "method must be"),
        ({"neighbours": 0}, "neighbours must be at least 1"),
        ({"neighbours": 2.5}, "neighbours must be a whole number"),
        ({"smoothing": -1.0}, "smoothing must be above 0"),
        ({"scales": [1.0]}, "scales must be"),
        ({"scales": [1.0, 0.0]}, "scales must be finite and above 0"),
        ({"scales": "wide"}, "scales must be"),
        ({"categorical": [2]}, "categorical must be among"),
        ({"categorical": [0, 1]}, "not all of them"),
    ],
)
def test_wrong_parameters_are_named_at_fit(parameters: dict[str, Any], sentence: str) -> None:
    regressor = RPTRegressor(**parameters)
    with pytest.raises(ValueError, match=sentence):
        regressor.fit(*taught(10))


@pytest.mark.parametrize(
    ("inputs", "outputs", "sentence"),
    [
        ([[np.nan, 1.0]], [1.0], "NaN"),
        ([[np.inf, 1.0]], [1.0], "infinity"),
        ([[0.0, 1.0]], [np.nan], "NaN"),
        ([[1e200, 1.0]], [1.0], "magnitude up to 1e"),
        ([[1.0, 1.0]], [1e200], "magnitude up to 1e"),
        (np.zeros((0, 2)), np.zeros(0), "0 sample"),
        (np.zeros((3, 0)), np.zeros(3), "0 feature"),
        (np.zeros((3, 2)), np.zeros(2), "inconsistent numbers"),
        (np.zeros(3), np.zeros(3), "Expected 2D array"),
        (np.zeros((3, 2, 1)), np.zeros(3), "dim 3"),
        ([["a", "b"]], [1.0], "could not convert"),
        (np.array([[1j, 1.0]]), [1.0], "[Cc]omplex"),
    ],
)
def test_bad_samples_are_refused(inputs: Any, outputs: Any, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        RPTRegressor().fit(inputs, outputs)


def test_groups_must_fit() -> None:
    inputs, outputs = taught(10)
    for groups in (np.zeros(9, int), np.zeros(10), np.full(10, -1)):
        with pytest.raises(ValueError, match="groups must be 10 whole numbers"):
            RPTRegressor().fit(inputs, outputs, groups)


# Without the compiler NumPy warns where a candidate extrapolates beyond what a double can hold.
MOST = 1e30 if JIT_OFF else 1e150
values = st.floats(-MOST, MOST) | st.sampled_from([0.0, 1.0, 1.0, -MOST, MOST, 5e-324, 0.1, 0.1 + 1e-17])


@given(data=st.data(), n=st.integers(1, 12), d=st.integers(1, 3), p=st.integers(1, 2))
@examples(60)
def test_finite_samples_get_finite_answers(data: st.DataObject, n: int, d: int, p: int) -> None:
    inputs = data.draw(arrays(np.float64, (n, d), elements=values))
    outputs = data.draw(arrays(np.float64, (n, p), elements=values))
    regressor = RPTRegressor().fit(inputs, outputs)
    assert regressor.predict(inputs).shape == (n, p)
    assert np.isfinite(regressor.predict(inputs)).all()


@given(n=st.integers(1, 40), constant=st.floats(-1e9, 1e9), seed=st.integers(0, 99))
@examples(25)
def test_constant_outputs_are_met(n: int, constant: float, seed: int) -> None:
    inputs = np.random.default_rng(seed).normal(size=(n, 2))
    predicted = RPTRegressor().fit(inputs, np.full(n, constant)).predict(inputs + 0.3)
    assert predicted == pytest.approx(np.full(n, constant), rel=1e-9, abs=1e-9)


def test_a_constant_input_component_means_nothing() -> None:
    inputs, outputs = taught(N)
    same = np.column_stack([inputs, np.full(N, 0.1)])
    expected = RPTRegressor().fit(inputs, outputs).predict(inputs + 0.01)
    found = RPTRegressor().fit(same, outputs).predict(np.column_stack([inputs + 0.01, np.full(N, 0.1)]))
    assert np.abs(found - expected).mean() < 0.02


@pytest.mark.skipif(JIT_OFF, reason="needs many samples")
def test_very_many_identical_points_answer_with_what_they_say() -> None:
    n = 10**5
    regressor = RPTRegressor().fit(np.full((n, 3), 7.0), np.tile([1.0, 3.0], n // 2))
    assert 1 <= regressor.predict([[7.0, 7.0, 7.0]])[0] <= 3
    assert regressor.explain([[7.0, 7.0, 7.0]]).distances[0, 0] == 0


def test_partial_fit_begins_as_fit_and_chooses_anew_when_samples_have_doubled() -> None:
    inputs, outputs = taught(2 * N)
    half = RPTRegressor().partial_fit(inputs[:N], outputs[:N])
    assert np.array_equal(half.predict(inputs), RPTRegressor().fit(inputs[:N], outputs[:N]).predict(inputs))
    first = half.selection_
    half.partial_fit(inputs[N : N + 10], outputs[N : N + 10])
    assert half.selection_ is first
    assert half.model_.samples == N + 10
    half.partial_fit(inputs[N + 10 :], outputs[N + 10 :])
    assert half.selection_ is not first
    whole = RPTRegressor().fit(inputs, outputs)
    assert half.settings_ == whole.settings_
    assert half.scales_ == pytest.approx(whole.scales_)
    assert half.predict(inputs + 0.01) == pytest.approx(whole.predict(inputs + 0.01), abs=1e-6)
    assert half.explain(inputs[-1:]).ids[0, 0] == 2 * N - 1


def test_partial_fit_refuses_other_outputs_and_learns_one_by_one() -> None:
    inputs, outputs = taught(12)
    regressor = RPTRegressor()
    for x, y in zip(inputs, outputs, strict=True):
        regressor.partial_fit([x], [y])
    assert regressor.model_.samples == 12
    with pytest.raises(ValueError, match="unlike what was learned: 2 outputs"):
        regressor.partial_fit(inputs, outputs[:, 0])
    assert regressor.model_.samples == 12


def test_categories_and_groups_survive_a_new_choice() -> None:
    inputs, outputs = taught(40)
    kinds = np.repeat([3.0, 8.0], 20)
    both = np.column_stack([inputs, kinds])
    outputs = outputs + kinds[:, np.newaxis] * 10
    groups = np.arange(40) // 4
    regressor = RPTRegressor(categorical=[2]).partial_fit(both[::4], outputs[::4], groups[::4])
    for first in (1, 2, 3):
        regressor.partial_fit(both[first::4], outputs[first::4], groups[first::4])
    assert regressor.model_.samples == 40
    assert np.abs(regressor.predict(both) - outputs).mean() < 1
    order = np.concatenate([groups[first::4] for first in range(4)])
    answer = regressor.explain(both)
    assert np.array_equal(answer.groups[:, 0], order[answer.ids[:, 0]])
    with pytest.raises(rpt.NotTaught, match="category"):
        regressor.predict([[0.0, 0.0, 5.0]])


@pytest.mark.skipif(JIT_OFF, reason="needs many samples")
def test_groups_make_it_choose_for_what_other_groups_say() -> None:
    rng = np.random.default_rng(0)
    count = 20
    centres = rng.uniform(-1, 1, (count, 2))
    inputs = np.repeat(centres, 10, axis=0) + rng.normal(0, 0.001, (10 * count, 2))
    groups = np.repeat(np.arange(count), 10)
    # Each group has an error of its own.
    outputs = inputs @ [1.0, 2.0] + rng.normal(0, 0.3, count)[groups]
    alone, together = RPTRegressor().fit(inputs, outputs), RPTRegressor().fit(inputs, outputs, groups)
    test = rng.uniform(-0.8, 0.8, (200, 2))
    errors = [float(np.abs(r.predict(test) - test @ [1.0, 2.0]).mean()) for r in (alone, together)]
    assert errors[1] < errors[0]


def test_pipeline_grid_search_and_pickle() -> None:
    inputs, outputs = taught(40)
    pipeline = make_pipeline(StandardScaler(), RPTRegressor())
    grid = {"rptregressor__method": ["nearest", "auto"]}
    search = GridSearchCV(pipeline, grid, cv=KFold(2)).fit(inputs, outputs)
    assert search.best_params_ == {"rptregressor__method": "auto"}
    fitted = search.best_estimator_
    again = pickle.loads(pickle.dumps(fitted))
    assert again.predict(inputs) == pytest.approx(fitted.predict(inputs))
    assert clone(fitted[-1]).get_params() == fitted[-1].get_params()


@pytest.mark.parametrize("name", ["handeye.rpt.estimator", "handeye.rpt"])
def test_without_scikit_learn(name: str) -> None:
    code = f"""
import sys
sys.modules["sklearn"] = None
import handeye.rpt
try:
    from {name} import RPTRegressor
except ImportError as error:
    assert "pip install 'handeye[estimator]'" in str(error), error
else:
    raise AssertionError
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_the_package_names_it() -> None:
    assert rpt.RPTRegressor is RPTRegressor
    assert "RPTRegressor" in dir(rpt)
    with pytest.raises(AttributeError, match="nonsense"):
        _ = rpt.nonsense
