"""Modules learn piece by piece, forget, and are restored."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from handeye.modules.answers import Neighbour, TaughtSamples
from handeye.modules.module import Module
from handeye.rpt import NotTaught
from tests.modules.toy_module import QUERIES, QUERY, declare, same, samples, taught, trained


def restored(module: Module, numbers: list[int], size: int) -> Module:
    """A module of these samples of `taught`, by their numbers."""
    first, second = samples(0, seed=0), samples(1, seed=1)
    order = [*range(20), *range(60, 120), *range(20, 60)]
    inputs, outputs = (np.concatenate([a, b])[order][numbers] for a, b in zip(first[:2], second[:2], strict=True))
    names = [None if i % 60 % 7 == 0 else (first[2] + second[2])[i] for i in np.array(order)[numbers]]
    return Module.restored(module.declaration, TaughtSamples(np.array(numbers), inputs, outputs, names), size)


def test_training_again_replaces_what_was_learned() -> None:
    module = trained(method="nearest")
    module.train([[0, 1.0, 2.0]], [[3.0, 4.0]], ["only"])
    assert module.answer([0, 0.0, 0.0]).output.tolist() == [3.0, 4.0]
    with pytest.raises(NotTaught):
        module.answer(QUERY)


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
