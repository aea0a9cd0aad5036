"""What modules answer, and what they say that it is made from."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from handeye.modules.answers import Answers
from handeye.modules.module import Module, warm_up
from handeye.rpt import NotTaught
from tests.modules.toy_module import QUERIES, QUERY, declare, right, same, samples, shown, taught, trained


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


def test_statistics_count_by_category() -> None:
    statistics = trained().statistics()
    assert [s.category for s in statistics] == [(0.0,), (1.0,)]
    assert [s.samples for s in statistics] == [60, 60]
    assert [s.demonstrations for s in statistics] == [6, 6]
    assert all(s.tree.samples == 60 for s in statistics)
    assert Module(declare()).statistics() == ()


def test_many_queries_are_answered_as_each_alone() -> None:
    module = taught(method="local_linear", neighbours=9)
    together = module.answers(QUERIES)
    assert together.samples.shape == (75, 9)
    for row, query in enumerate(QUERIES):
        alone, same_alone = module.answer(query), module.answers(query[np.newaxis])
        np.testing.assert_allclose(together.outputs[row], alone.output, rtol=1e-12)
        assert together.support[row] == pytest.approx(alone.support)
        np.testing.assert_allclose(together.expected_error[row], alone.expected_error)
        told = [(n.sample_id, n.demonstration) for n in alone.neighbours]
        assert list(zip(together.samples[row].tolist(), shown(together)[row].tolist(), strict=True)) == told
        assert list(zip(same_alone.samples[0].tolist(), shown(same_alone)[0].tolist(), strict=True)) == told
        np.testing.assert_allclose(together.distances[row], [n.distance for n in alone.neighbours])
        np.testing.assert_allclose(together.weights[row], [n.weight for n in alone.neighbours])
    assert None in shown(together)


def test_without_categories_it_is_the_same() -> None:
    declaration = declare(method="kndb", neighbours=3)
    module = Module(declaration.model_copy(update={"inputs": declaration.inputs[1:]}))
    inputs, outputs, names = samples(0)
    module.learn(inputs[:, 1:], outputs, names)
    with_category = Module(declaration)
    with_category.learn(inputs, outputs, names)
    ours = [query for query in QUERIES if query[0] == 0.0]
    same(module.answers([query[1:] for query in ours]), with_category.answers(ours))


def test_neighbours_that_are_not_there_are_empty() -> None:
    module = Module(declare(method="kndb", neighbours=4))
    module.learn([[0, 1.0, 0.0], [0, 2.0, 0.0], [1, 1.0, 0.0]], np.zeros((3, 2)), ["a", None, "b"])
    said = module.answers([[0, 1.0, 0.0], [1, 1.0, 0.0]])
    assert said.samples.tolist() == [[0, 1], [2, -1]]
    assert said.demonstrations.tolist() == [[0, -1], [1, -1]]
    assert said.distances[1].tolist() == [0.0, np.inf]
    assert said.weights[1].tolist() == [1.0, 0.0]


def test_one_of_several_queries_without_an_answer_is_named() -> None:
    with pytest.raises(NotTaught, match=r"\(subtask\) = \(7.0,\)"):
        taught().answers([QUERY, [7.0, 0.0, 0.0]])


def test_the_nearest_neighbours_only() -> None:
    module = taught(method="kndb", neighbours=6)
    said = module.answers(QUERIES)
    cut = said.nearest(2)
    assert cut.samples.tolist() == said.samples[:, :2].tolist()
    assert cut.outputs.tolist() == said.outputs.tolist()
    assert said.nearest(0).samples.shape == (75, 0)
    assert said.nearest(99).samples.shape == (75, 6)
    assert len(module.answer(QUERY, 2).neighbours) == 2
    assert module.answer(QUERY, 0).neighbours == ()
    assert module.answer(QUERY, 0).support == module.answer(QUERY).support


def test_answers_in_pieces_are_the_answers() -> None:
    module = taught(method="kndb", neighbours=6)
    whole = module.answers(QUERIES)
    joined = Answers.joined([module.answers(QUERIES[i : i + 20]) for i in range(0, 75, 20)])
    same(joined, whole)
    np.testing.assert_array_equal(joined.support, whole.support)
    # In between samples came: later answers have more neighbours and know more names.
    few = Module(declare(method="kndb", neighbours=3))
    few.learn([QUERY], [[1.0, 1.0]], ["a"])
    before = few.answers([QUERY])
    few.learn([[1.0, 43.0, 0.4], [1.0, 44.0, 0.4]], [[1.0, 1.0]] * 2, ["b", None])
    joined = Answers.joined([before, few.answers([QUERY])])
    assert joined.samples.tolist() == [[0, -1, -1], [0, 1, 2]]
    assert shown(joined).tolist() == [["a", None, None], ["a", "b", None]]
    assert joined.distances[0, 1:].tolist() == [np.inf, np.inf]


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
