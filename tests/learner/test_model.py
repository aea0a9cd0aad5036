"""The model: what it learns, answers, forgets, and refuses."""

from __future__ import annotations

import pickle
import threading
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from handeye.rpt import Model, NotTaught, Settings, approximate
from handeye.rpt.settings import METHODS
from tests.learner.forms import JIT_OFF

Floats = NDArray[np.float64]

MATRIX = np.array([[1.0, -2.0, 0.5], [0.3, 0.0, 1.0]])


def linear(n: int, seed: int = 0) -> tuple[Floats, Floats]:
    inputs = np.random.default_rng(seed).normal(size=(n, 3))
    return inputs, inputs @ MATRIX.T + 1


def taught(method: str = "kndb2", n: int = 80, **chosen: Any) -> tuple[Model, Floats, Floats]:
    model = Model(3, 2, Settings(method=method, **chosen))  # type: ignore[arg-type]
    inputs, outputs = linear(n)
    model.learn(inputs, outputs)
    return model, inputs, outputs


# --- answers ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_every_method_answers_at_a_sample(method: str) -> None:
    model, inputs, outputs = taught(method, smoothing=1e-4, ridge=1e-9)
    answer = model.answer(inputs[7])
    assert answer.output == pytest.approx(outputs[7], abs=1e-4)
    assert answer.ids[0] == 7
    assert answer.distances[0] == 0
    assert answer.weights.sum() == pytest.approx(1)


@pytest.mark.parametrize("method", ["kndb2", "local_linear", "local_quadratic", "leaf_map"])
def test_methods_with_slopes_reproduce_a_linear_map_and_its_gradient(method: str) -> None:
    model, _, _ = taught(method, neighbours=20, ridge=1e-9, curvature_ridge=1e-9)
    query = np.array([0.2, -0.1, 0.3])
    answer = model.answer(query)
    assert answer.output == pytest.approx(MATRIX @ query + 1, abs=1e-5)
    assert answer.gradient == pytest.approx(MATRIX, abs=1e-4)
    assert answer.determined


def test_the_gradient_is_the_derivative_of_the_answer() -> None:
    rng = np.random.default_rng(3)
    inputs = rng.uniform(-1, 1, (200, 2))
    model = Model(2, 1, Settings("local_quadratic", neighbours=200, curvature_ridge=1e-9, smoothing=1e3), scales=[1, 3])
    model.learn(inputs, inputs[:, :1] ** 2 + inputs[:, :1] * inputs[:, 1:])
    query = np.array([0.3, -0.4])
    assert model.answer(query).gradient == pytest.approx(np.array([[2 * 0.3 - 0.4, 0.3]]), abs=1e-3)


def test_a_degenerate_neighbourhood_is_flagged_and_not_wild() -> None:
    line = np.column_stack([np.linspace(0, 1, 40), np.zeros(40)])
    for method in ("kndb2", "local_linear", "leaf_map"):
        model = Model(2, 1, Settings(method, neighbours=10))
        model.learn(line, line[:, :1])
        answer = model.answer([0.5, 3.0])
        assert not answer.determined
        assert abs(answer.output[0] - 0.5) < 0.1


def test_several_queries_are_answered_as_one_by_one() -> None:
    model, _, _ = taught()
    queries = linear(15, seed=1)[0]
    together = model.answers(queries)
    for i, query in enumerate(queries):
        one = model.answer(query)
        for name in ("output", "gradient", "support", "ids", "distances", "weights", "expected_error", "groups"):
            assert np.array_equal(getattr(together, name)[i], getattr(one, name)), name
    assert model.answers(np.zeros((0, 3))).output.shape == (0, 2)


def test_one_query_may_come_in_any_form() -> None:
    model, _, _ = taught()
    expected = model.answer(np.array([1.0, 0.0, 2.0])).output
    wide = np.array([[1.0, 9.0], [0.0, 9.0], [2.0, 9.0]])
    for query in ([1, 0, 2], (1.0, 0.0, 2.0), np.array([1, 0, 2]), np.array([1, 0, 2], np.float32), wide[:, 0]):
        assert np.array_equal(model.answer(query).output, expected)


def test_scales_decide_what_is_near() -> None:
    for scales, nearest in (([1.0, 1.0], 1), ([1.0, 0.01], 0)):
        model = Model(2, 1, Settings("nearest"), scales=scales)
        model.learn([[5.0, 0.0], [0.0, 0.1]], [[0.0], [1.0]])
        assert model.answer([0.0, 0.0]).ids.tolist() == [nearest]


def test_fewer_samples_than_neighbours_are_enough() -> None:
    model = Model(3, 2, Settings("kndb", neighbours=5))
    model.learn([[0.0, 0, 0], [1.0, 0, 0]], [[1.0, 2], [1.0, 2]])
    answer = model.answer([0.5, 0, 0])
    assert answer.ids.tolist() == [0, 1]
    assert answer.output == pytest.approx([1, 2])


# --- categories -------------------------------------------------------------------------------------------------------


def categories() -> tuple[Model, Floats]:
    model = Model(2, 1, Settings("kndb", neighbours=3), categorical=[0])
    inputs = np.column_stack([np.repeat([0.0, 7.0], [5, 2]), np.arange(7.0)])
    model.learn(inputs, inputs[:, :1], groups=[0, 0, 1, 1, 2, 2, 2])
    return model, inputs


def test_neighbours_never_cross_categories() -> None:
    model, _ = categories()
    assert model.answer([0, 6.0]).ids.tolist() == [4, 3, 2]
    assert model.answer([7, 0.0]).ids.tolist() == [5, 6]
    with pytest.raises(NotTaught, match=r"nothing was learned for category \(3.0,\); learned: \(0.0,\), \(7.0,\)"):
        model.answer([3, 0.0])


def test_queries_of_several_categories_at_once() -> None:
    model, _ = categories()
    answer = model.answers([[7, 0.0], [0, 6.0], [7, 9.0]])
    assert answer.ids.tolist() == [[5, 6, -1], [4, 3, 2], [6, 5, -1]]
    assert answer.output[:, 0].tolist() == [7, 0, 7]
    assert answer.weights.sum(axis=1) == pytest.approx([1, 1, 1])
    assert answer.distances[0].tolist() == [5, 6, np.inf]
    assert answer.groups.tolist() == [[2, 2, -1], [2, 1, 1], [2, 2, -1]]
    assert answer.support.shape == (3,)
    assert answer.expected_error.shape == (3, 1)
    assert np.array_equal(answer.gradient, np.zeros((3, 1, 2)))


def test_statistics_by_category() -> None:
    statistics = categories()[0].statistics()
    assert [(c, s.samples, s.groups, s.tree.samples) for c, s in statistics.items()] == [
        ((0.0,), 5, 3, 5),
        ((7.0,), 2, 1, 2),
    ]


# --- learning and forgetting ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_learning_sample_by_sample_is_learning_at_once(method: str) -> None:
    inputs, outputs = linear(60)
    outputs = outputs**2
    whole, grown = (Model(3, 2, Settings(method)) for _ in range(2))  # type: ignore[arg-type]
    whole.learn(inputs, outputs)
    for i in range(60):
        assert grown.learn(inputs[i : i + 1], outputs[i : i + 1]).tolist() == [i]
        answer = grown.answer(inputs[i])
        assert (answer.ids[0], answer.distances[0]) == (i, 0)
    grown.repair()
    queries = linear(20, seed=5)[0]
    assert np.array_equal(grown.answers(queries).ids, whole.answers(queries).ids)
    assert np.allclose(grown.answers(queries).output, whole.answers(queries).output, rtol=1e-12)


@pytest.mark.parametrize("method", ["kndb2", "local_linear", "leaf_map"])
def test_what_is_forgotten_leaves_no_trace(method: str) -> None:
    inputs, outputs = linear(90)
    outputs = np.sin(outputs)
    outputs[30:60] += 1000.0  # what must not shine through, also not through gradients
    model, other = (Model(3, 2, Settings(method)) for _ in range(2))  # type: ignore[arg-type]
    model.learn(inputs, outputs, groups=np.arange(90) // 30)
    assert model.forget_group(1).tolist() == list(range(30, 60))
    kept = np.r_[:30, 60:90]
    other.learn(inputs[kept], outputs[kept], groups=kept // 30)
    queries = linear(25, seed=6)[0]
    left, right = model.answers(queries), other.answers(queries)
    assert np.array_equal(left.ids, kept[right.ids])
    assert np.array_equal(left.output, right.output)
    assert np.array_equal(left.support, right.support)
    assert model.samples == 60
    with pytest.raises(ValueError, match="no sample belongs to group 1"):
        model.forget_group(1)


def test_forgetting_everything_and_learning_again() -> None:
    model, inputs, _ = taught(n=20)
    model.forget(np.arange(20))
    with pytest.raises(NotTaught, match="nothing has been learned yet"):
        model.answer(inputs[0])
    assert model.learn([[0.0, 0, 0]], [[5.0, 6.0]]).tolist() == [20]
    answer = model.answer([1.0, 1, 1])
    assert answer.output.tolist() == [5, 6]
    assert answer.ids.tolist() == [20]
    with pytest.raises(ValueError, match="can be forgotten once"):
        model.forget(3)
    model.forget(20)
    assert model.samples == 0


def test_a_copy_knows_that_the_last_sample_is_gone() -> None:
    model, _, _ = taught(n=10)
    model.forget([8, 9])
    copy = Model.from_state(*model.to_state())
    with pytest.raises(ValueError, match="can be forgotten once and must be among 0 to 9"):
        copy.forget(9)
    copy.forget(7)
    assert copy.samples == 7


def test_given_derivatives_are_used_and_kept() -> None:
    rng = np.random.default_rng(2)
    inputs = rng.uniform(0.5, 1, (30, 2))
    outputs = inputs**2
    gradients = np.zeros((30, 2, 2))
    gradients[:, [0, 1], [0, 1]] = 2 * inputs
    step = 1e-3 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    around = inputs[:, np.newaxis] + step
    for known in ({"gradients": gradients}, {"derived": (around, around**2)}):
        model = Model(2, 2, Settings("leaf_map"), scales=[0.1, 2.0])
        model.learn(inputs, outputs, **known)
        model.learn([[0.7, 0.7]], [[0.49, 0.49]])  # one more, without
        query = inputs[4] + [0.002, -0.001]
        assert model.answer(query).output == pytest.approx(query**2, abs=1e-5)
        assert model.answer(query).gradient == pytest.approx(gradients[4], abs=1e-3)


def test_a_leaf_map_is_the_least_squares_map_of_its_derived_points() -> None:
    rng = np.random.default_rng(1)
    sample, output = rng.normal(size=3), rng.normal(size=2)
    derived, said = rng.normal(size=(6, 3)), rng.normal(size=(6, 2))
    expected = np.linalg.lstsq(derived - sample, said - output, rcond=None)[0].T
    assert approximate.leaf_map(sample, output, derived, said, ridge=1e-12) == pytest.approx(expected, abs=1e-9)


# --- threads ----------------------------------------------------------------------------------------------------------


def test_queries_go_on_while_samples_come_and_go() -> None:
    model = Model(3, 2, Settings("kndb2", ridge=1e-9))
    inputs, outputs = linear(700)
    model.learn(inputs[:60], outputs[:60])
    queries = linear(20, seed=9)[0] * 0.3
    wrong: list[str] = []
    done = threading.Event()

    def ask() -> None:
        while not done.is_set():
            for query in queries:
                said = model.answer(query).output
                if not np.allclose(said, MATRIX @ query + 1, atol=1e-3):
                    wrong.append(f"{query}: {said}")

    readers = [threading.Thread(target=ask) for _ in range(2)]
    for reader in readers:
        reader.start()
    try:
        for i in range(60, 75 if JIT_OFF else 300):
            model.learn(inputs[i : i + 1], outputs[i : i + 1])
            if i % 50 == 14:
                model.forget(i - 10)
                model.repair()
    finally:
        done.set()
        for reader in readers:
            reader.join(10)
    assert not wrong


def test_an_answer_stays_what_it_was() -> None:
    model, inputs, _ = taught("kndb2", n=30)
    answer = model.answer(inputs[3])
    before = (answer.output.tolist(), answer.ids.tolist(), answer.groups.tolist(), answer.expected_error.tolist())
    more, values = linear(200, seed=4)
    model.learn(more, values + 5)
    assert before == (
        answer.output.tolist(),
        answer.ids.tolist(),
        answer.groups.tolist(),
        answer.expected_error.tolist(),
    )


def test_a_model_can_be_pickled_for_libraries_that_do() -> None:
    model, _, _ = taught("kndb2")
    model.forget([3, 4])
    copy = pickle.loads(pickle.dumps(model))
    queries = linear(10, seed=3)[0]
    assert np.array_equal(copy.answers(queries).output, model.answers(queries).output)
    assert copy.learn([[0.0, 0, 0]], [[0.0, 0]]).tolist() == [80]


# --- bad input --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("declared", "message"),
    [
        ({"components": 0}, "at least one input"),
        ({"outputs": 0}, "at least one input"),
        ({"scales": [1, 1]}, "scales must be 3 finite numbers above 0"),
        ({"scales": [1, 0, 1]}, "scales must be"),
        ({"scales": [1, np.nan, 1]}, "scales must be"),
        ({"categorical": [3]}, "among 0 to 2"),
        ({"categorical": [0, 1, 2]}, "no"),
        ({"radii": [1, 2]}, "decreasing"),
    ],
)
def test_impossible_declarations(declared: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Model(**{"components": 3, "outputs": 2} | declared)


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ({"method": "magic"}, "method must be one of nearest, kndb"),
        ({"neighbours": 0}, "neighbours must be at least 1"),
        ({"alpha": 0.5}, "alpha must be at least 1"),
        ({"smoothing": 0.0}, "smoothing must be above 0"),
        ({"ridge": 0.0}, "ridge must be"),
        ({"beam_width": 2}, "beam_width must be at least neighbours, 5"),
    ],
)
def test_impossible_settings(chosen: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Settings(**chosen)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[1.0, 2]], [[1.0, 2]]), "inputs: expected vectors of 3 components"),
        (([[1.0, 2, 3]], [[1.0]]), "outputs: expected vectors of 2 components"),
        (([[1.0, 2, 3]], [[1.0, 2]] * 2), "1 inputs and 2 outputs"),
        (([[1.0, np.nan, 3]], [[1.0, 2]]), r"inputs must be finite .* number \[0, 1\] is nan"),
        (([[1.0, 2, 3]], [[1.0, np.inf]]), r"outputs must be finite"),
        (([[1.0, 2, 3]], [[1.0, 2]], [0.5]), "groups must be 1 whole numbers"),
        (([[1.0, 2, 3]], [[1.0, 2]], [-1]), "groups must be 1 whole numbers >= 0"),
    ],
)
def test_bad_samples_are_refused_and_change_nothing(arguments: tuple[Any, ...], message: str) -> None:
    model, inputs, _ = taught(n=10)
    before = model.answer(inputs[0]).output
    with pytest.raises(ValueError, match=message):
        model.learn(*arguments)
    assert model.samples == 10
    assert np.array_equal(model.answer(inputs[0]).output, before)
    assert model.learn(inputs[:1], [[0.0, 0]]).tolist() == [10]


def test_bad_derivatives_are_refused() -> None:
    model, inputs, outputs = taught(n=10)
    for derivatives, message in (
        ({"gradients": np.zeros((10, 3, 2))}, r"gradients must have shape \(10, 2, 3\)"),
        ({"derived": (np.zeros((10, 3)), np.zeros((10, 2)))}, "derived inputs must have shape"),
        ({"derived": (np.zeros((10, 4, 3)), np.zeros((10, 5, 2)))}, "derived outputs must have shape"),
        ({"gradients": np.zeros((10, 2, 3)), "derived": (np.zeros(1), np.zeros(1))}, "not both"),
    ):
        with pytest.raises(ValueError, match=message):
            model.learn(inputs, outputs, **derivatives)
    with pytest.raises(ValueError, match="kndb uses no gradients"):
        taught("kndb", n=4)[0].learn(inputs, outputs, gradients=np.zeros((10, 2, 3)))


@pytest.mark.parametrize(
    ("query", "message"),
    [
        ([1.0, 2.0], "expected vectors of 3"),
        (np.zeros(2), "expected vectors of 3"),
        (np.zeros(4), "expected vectors of 3"),
        ([1.0, np.nan, 2.0], "finite"),
        (np.array([1.0, np.inf, 2.0]), "finite"),
        (np.array([1e200, 0.0, 0.0]), "finite"),
        (np.zeros((1, 3)), "one query is a vector of 3 components"),
        (0.0, "one query"),
    ],
)
def test_bad_queries_are_refused(query: Any, message: str) -> None:
    model, _, _ = taught(n=10)
    with pytest.raises(ValueError, match=message):
        model.answer(query)


@given(seed=st.integers(0, 10**6), n=st.integers(1, 25), d=st.integers(1, 3), method=st.sampled_from(METHODS))
@settings(deadline=None, max_examples=40)
def test_any_samples_give_finite_answers(seed: int, n: int, d: int, method: Any) -> None:
    rng = np.random.default_rng(seed)
    inputs = np.round(rng.normal(size=(n, d)) * rng.choice([1e-8, 1.0, 1e8]), int(rng.integers(0, 9)))
    outputs = rng.normal(size=(n, 2)) if rng.random() < 0.7 else np.full((n, 2), 3.0)
    model = Model(d, 2, Settings(method, neighbours=int(rng.integers(1, 8))))
    model.learn(inputs, outputs, groups=rng.integers(0, 4, n))
    answer = model.answers(np.concatenate([inputs, rng.normal(size=(5, d))]))
    for values in (answer.output, answer.gradient, answer.weights):
        assert np.all(np.isfinite(values))
    assert np.all((answer.support > 0) & (answer.support <= 1))
    assert not np.any(np.isnan(answer.expected_error))
