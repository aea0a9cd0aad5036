from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from handeye.modules.answers import Support
from handeye.modules.declaration import ApproximatorSettings, Component, ModuleDeclaration, Output
from handeye.modules.module import Module, warm_up
from handeye.rpt import NotTaught

Floats = NDArray[np.float64]


def declare(**settings: Any) -> ModuleDeclaration:
    return ModuleDeclaration(
        name="toy",
        inputs=(
            Component(name="subtask", unit="", categorical=True),
            Component(name="x", unit="px", scale=10.0),
            Component(name="y", unit="rad", scale=0.1),
        ),
        outputs=(Output(name="u", unit="rad"), Output(name="v", unit="rad")),
        approximator=ApproximatorSettings.model_validate(settings),
    )


def samples(subtask: float, n: int = 60, seed: int = 0) -> tuple[Floats, Floats, list[str]]:
    """Samples of a linear function of its own for each subtask, from six demonstrations."""
    rng = np.random.default_rng(seed)
    inputs = np.column_stack([np.full(n, subtask), rng.uniform(0, 100, n), rng.uniform(0, 1, n)])
    return inputs, right(inputs), [f"demonstration {i % 6}" for i in range(n)]


def right(inputs: Floats) -> Floats:
    s, x, y = inputs.T
    return np.column_stack([(1 + s) * x / 100 - y, 10 * s + y])


def trained(**settings: Any) -> Module:
    module = Module(declare(**settings))
    a, b = samples(0), samples(1, seed=1)
    module.train(np.concatenate([a[0], b[0]]), np.concatenate([a[1], b[1]]), a[2] + b[2])
    return module


QUERY = [1.0, 42.0, 0.4]


@pytest.mark.parametrize(
    ("settings", "tolerance"),
    [
        ({"method": "local_linear", "ridge": 1e-9}, 1e-5),
        ({"method": "local_quadratic", "neighbours": None, "ridge": 1e-9, "curvature_ridge": 1e-9}, 1e-5),
        ({"method": "kndb2", "neighbours": 5, "ridge": 1e-9}, 1e-5),
        ({"method": "kndb2", "neighbours": 5, "ridge": 1e-9, "keep_covered": False}, 1e-5),
        ({"method": "kndb", "neighbours": 5}, 0.2),
        ({"method": "kndb", "neighbours": 5, "search": "beam"}, 0.2),
        ({"method": "nearest"}, 0.3),
    ],
)
def test_every_method_answers(settings: dict[str, Any], tolerance: float) -> None:
    answer = trained(**settings).answer(QUERY)
    assert answer.output == pytest.approx(right(np.array([QUERY]))[0], abs=tolerance)
    assert sum(neighbour.weight for neighbour in answer.neighbours) == pytest.approx(1)


def test_neighbours_never_cross_categories() -> None:
    module = trained(method="kndb", neighbours=60)
    assert {n.sample_id for n in module.answer([0.0, 50.0, 0.5]).neighbours} == set(range(60))
    assert {n.sample_id for n in module.answer([1.0, 50.0, 0.5]).neighbours} == set(range(60, 120))


def test_an_answer_says_where_it_comes_from() -> None:
    inputs, _, names = samples(0)
    module = trained(method="kndb", neighbours=4)
    query = np.array([0.0, 42.0, 0.4])
    answer = module.answer(query)
    distances = np.linalg.norm((inputs - query)[:, 1:] / [10.0, 0.1], axis=1)
    expected = np.argsort(distances)[:4]
    assert [n.sample_id for n in answer.neighbours] == expected.tolist()
    assert [n.demonstration for n in answer.neighbours] == [names[i] for i in expected]
    assert [n.distance for n in answer.neighbours] == pytest.approx(distances[expected].tolist())


def test_scales_decide_what_is_near() -> None:
    declaration = declare(method="nearest")
    inputs, outputs = [[0, 0.0, 0.0], [0, 30.0, 0.2]], [[1.0, 1.0], [2.0, 2.0]]
    query = [0, 18.0, 0.05]  # nearer to the first by y, to the second by x
    by_y = Module(declaration)
    by_y.train(inputs, outputs, ["a", "b"])
    assert by_y.answer(query).output.tolist() == [1.0, 1.0]
    wide = declaration.inputs[2].model_copy(update={"scale": 100.0})
    by_x = Module(declaration.model_copy(update={"inputs": (*declaration.inputs[:2], wide)}))
    by_x.train(inputs, outputs, ["a", "b"])
    assert by_x.answer(query).output.tolist() == [2.0, 2.0]


def test_fewer_samples_than_neighbours_are_enough() -> None:
    module = Module(declare(method="local_linear", neighbours=30))
    module.train([[0, 1.0, 2.0]], [[3.0, 4.0]], ["only"])
    answer = module.answer([0, 500.0, 0.0])
    assert answer.output.tolist() == [3.0, 4.0]
    assert len(answer.neighbours) == 1


def test_training_again_replaces_what_was_learned() -> None:
    module = trained(method="nearest")
    module.train([[0, 1.0, 2.0]], [[3.0, 4.0]], ["only"])
    assert module.answer([0, 0.0, 0.0]).output.tolist() == [3.0, 4.0]
    with pytest.raises(NotTaught):
        module.answer(QUERY)


def test_statistics_count_by_category() -> None:
    statistics = trained().statistics()
    assert [s.category for s in statistics] == [(0.0,), (1.0,)]
    assert [s.samples for s in statistics] == [60, 60]
    assert [s.demonstrations for s in statistics] == [6, 6]
    assert all(s.tree.samples == 60 for s in statistics)
    assert Module(declare()).statistics() == ()


# --- support --------------------------------------------------------------------------------------------------------


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


def test_a_single_sample_supports_only_itself() -> None:
    module = Module(declare())
    module.train([[0, 0.0, 0]], [[0.0, 0.0]], ["a"])
    assert module.answer([0, 0.0, 0]).support == 1.0
    assert module.answer([0, 0.1, 0]).support == 0.0


# --- errors ---------------------------------------------------------------------------------------------------------


def test_nothing_taught_is_said() -> None:
    with pytest.raises(NotTaught, match="'toy' has not been taught anything yet"):
        Module(declare()).answer(QUERY)
    with pytest.raises(NotTaught, match=r"taught nothing for \(subtask\) = \(7.0,\); taught: \(0.0,\), \(1.0,\)"):
        trained().answer([7, 1.0, 1.0])


@pytest.mark.parametrize(
    ("inputs", "outputs", "names", "message"),
    [
        ([[0.0, 1.0]], [[1.0, 1.0]], ["a"], "inputs must have 3 components"),
        ([[0.0, 1.0, 2.0]], [[1.0]], ["a"], "outputs must have 2 components"),
        ([[0.0, 1.0, 2.0]], [[1.0, 1.0]], ["a", "b"], "1 inputs, 1 outputs and 2 demonstrations"),
        ([[0.0, 1.0, 2.0]] * 2, [[1.0, 1.0]], ["a", "b"], "2 inputs, 1 outputs and 2 demonstrations"),
        ([[0.0, np.nan, 2.0]], [[1.0, 1.0]], ["a"], "inputs must be finite"),
        ([[0.0, 1.0, 2.0]], [[1.0, np.inf]], ["a"], "outputs must be finite"),
        (np.zeros((0, 3)), np.zeros((0, 2)), [], "inputs must have 3 components"),
    ],
)
def test_bad_samples_are_errors(inputs: Any, outputs: Any, names: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Module(declare()).train(inputs, outputs, names)


@pytest.mark.parametrize("query", [[0.0, 1.0], [0.0, 1.0, np.nan], [[0.0, 1.0, 1.0], [0.0, 1.0, 1.0]]])
def test_bad_queries_are_errors(query: Any) -> None:
    with pytest.raises(ValueError, match="query"):
        trained().answer(query)


def test_warm_up_leaves_nothing_to_compile() -> None:
    warm_up()
    warm_up()
