from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from handeye.modules.answers import Answers, Neighbour, Support, TaughtSamples
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


def test_a_single_sample_supports_what_its_scales_do_not_count_as_different() -> None:
    module = Module(declare())
    module.train([[0, 0.0, 0]], [[0.0, 0.0]], ["a"])
    assert module.answer([0, 0.0, 0]).support == 1.0
    assert module.answer([0, 0.1, 0]).support > 0.9  # a hundredth of the scale away
    assert module.answer([0, 5.0, 0]).support == pytest.approx(0.5)
    assert module.answer([0, 50.0, 0]).support == pytest.approx(0.05)


# --- learning, forgetting, restoring --------------------------------------------------------------------------------


def taught(**settings: Any) -> Module:
    """The same samples as `trained`, learned in four pieces; every seventh came from no demonstration."""
    module = Module(declare(**settings))
    for subtask, part in ((0, slice(0, 20)), (1, slice(0, 60)), (0, slice(20, 45)), (0, slice(45, 60))):
        inputs, outputs, names = samples(subtask, seed=subtask)
        shown = [None if i % 7 == 0 else name for i, name in enumerate(names)]
        module.learn(inputs[part], outputs[part], shown[part])
    return module


def restored(module: Module, numbers: list[int], size: int) -> Module:
    """A module of these samples of `taught`, by their numbers."""
    first, second = samples(0, seed=0), samples(1, seed=1)
    order = [*range(20), *range(60, 120), *range(20, 60)]
    inputs, outputs = (np.concatenate([a, b])[order][numbers] for a, b in zip(first[:2], second[:2], strict=True))
    names = [None if i % 60 % 7 == 0 else (first[2] + second[2])[i] for i in np.array(order)[numbers]]
    return Module.restored(module.declaration, TaughtSamples(np.array(numbers), inputs, outputs, names), size)


def same(one: Answers, other: Answers) -> None:
    for name in ("outputs", "samples", "distances", "weights"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    np.testing.assert_array_equal(shown(one), shown(other))


def shown(answers: Answers) -> NDArray[np.object_]:
    return np.array([*answers.names, None], dtype=object)[answers.demonstrations]


QUERIES = np.concatenate([samples(s, 25, seed=9)[0] for s in (0, 1, 0)])[np.random.default_rng(0).permutation(75)]


def test_samples_are_numbered_as_they_come() -> None:
    module = Module(declare())
    inputs, outputs, names = samples(0)
    assert module.learn(inputs[:3], outputs[:3], names[:3]).tolist() == [0, 1, 2]
    module.forget([0, 2])
    assert module.learn(inputs[3:5], outputs[3:5], names[3:5]).tolist() == [3, 4]
    assert module.samples == 3
    assert {neighbour.sample_id for neighbour in module.answer([0, 50.0, 0.5]).neighbours} == {1, 3, 4}


def test_learning_piece_by_piece_is_learning_all() -> None:
    pieces, order = taught(), [*range(20), *range(60, 120), *range(20, 60)]
    inputs, outputs = (
        np.concatenate([a, b])[order] for a, b in zip(samples(0)[:2], samples(1, seed=1)[:2], strict=True)
    )
    whole = Module(declare())
    whole.learn(inputs, outputs, [None if i % 60 % 7 == 0 else f"demonstration {i % 60 % 6}" for i in order])
    same(pieces.answers(QUERIES), whole.answers(QUERIES))


def test_what_is_forgotten_is_asked_no_more() -> None:
    module = taught(method="kndb", neighbours=5)
    near = [neighbour.sample_id for neighbour in module.answer(QUERY).neighbours]
    module.forget(near[:2])
    left = [neighbour.sample_id for neighbour in module.answer(QUERY).neighbours]
    assert left[:3] == near[2:]
    assert module.samples == 118
    with pytest.raises(ValueError, match="forgotten once"):
        module.forget(near[:1])
    assert module.samples == 118


def test_a_category_that_was_forgotten_can_be_taught_again() -> None:
    module = taught()
    module.forget(range(20, 80))  # all of subtask 1
    with pytest.raises(NotTaught, match="taught nothing for"):
        module.answer(QUERY)
    assert [each.category for each in module.statistics()] == [(0.0,)]
    module.learn([QUERY], [[3.0, 4.0]], ["new"])
    assert module.answer(QUERY).output.tolist() == [3.0, 4.0]
    assert module.answer(QUERY).neighbours[0].demonstration == "new"


@pytest.mark.parametrize("method", ["local_linear", "local_quadratic", "kndb", "nearest"])
def test_a_restored_module_answers_to_the_last_bit(method: str) -> None:
    module = taught(method=method, neighbours=8)
    gone = [0, 3, 25, 70, 119]
    module.forget(gone)
    again = restored(module, [n for n in range(120) if n not in gone], 120)
    same(module.answers(QUERIES), again.answers(QUERIES))
    assert again.samples == module.samples == 115
    # And it goes on as the one before would have.
    for each in (module, again):
        assert each.learn([QUERY], [[0.0, 0.0]], ["later"]).tolist() == [120]
        each.forget([4, 120])
    same(module.answers(QUERIES), again.answers(QUERIES))
    with pytest.raises(ValueError, match="forgotten once"):
        again.forget([3])


def test_numbers_of_samples_that_are_gone_are_not_used_again() -> None:
    module = restored(taught(), [], 500)
    assert module.samples == 0
    with pytest.raises(NotTaught):
        module.answer(QUERY)
    assert module.learn([QUERY], [[1.0, 2.0]], [None]).tolist() == [500]
    assert module.answer(QUERY).neighbours == (Neighbour(500, None, 0.0, 1.0),)


@pytest.mark.parametrize(("numbers", "size"), [([3, 2], 120), ([0, 0], 120), ([5, 6], 6), ([-1, 0], 120)])
def test_numbers_that_cannot_be_are_errors(numbers: list[int], size: int) -> None:
    with pytest.raises(ValueError, match="ascend"):
        restored(taught(), numbers, size)


def test_restoring_checks_the_samples() -> None:
    wrong = TaughtSamples(np.arange(1), np.array([[0.0, np.nan, 0.0]]), np.zeros((1, 2)), ["a"])
    with pytest.raises(ValueError, match="finite"):
        Module.restored(declare(), wrong, 1)


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
    assert supports == pytest.approx([0.25, 0.125, 0.0625], rel=1e-3)


def test_queries_go_on_while_samples_come_and_go() -> None:
    module, stop, errors = trained(), threading.Event(), list[BaseException]()

    def ask() -> None:
        try:
            while not stop.is_set():
                said = module.answers(QUERIES)
                assert np.isfinite(said.outputs).all()
                assert said.demonstrations.max() < len(said.names)
                module.answer(QUERY, 3)
                module.statistics()
        except BaseException as error:
            errors.append(error)

    askers = [threading.Thread(target=ask) for _ in range(2)]
    for asker in askers:
        asker.start()
    for turn in range(40):
        inputs, outputs, _ = samples(turn % 2, 20, seed=turn)
        module.forget(module.learn(inputs, outputs, [f"turn {turn}"] * 20)[::2])
    stop.set()
    for asker in askers:
        asker.join(30.0)
    assert errors == []
    assert module.samples == 120 + 40 * 10


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
