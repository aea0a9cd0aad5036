"""Pairs from demonstrations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from handeye.modules import ijs
from handeye.modules.declaration import ApproximatorSettings
from handeye.modules.spaces import ImagePair, ImagePoint
from handeye.server.demonstrations import Demonstration, Demonstrations, Incomplete
from handeye.server.problem import NotFound
from handeye.server.training import NotTeachable, Tasks, TrainRequest, common_subtasks, declare, pairs

if TYPE_CHECKING:
    from numpy.typing import NDArray

FOUND = ImagePair(object=ImagePoint(200.0, 300.0, 150.0), hand=ImagePoint(190.0, 320.0, 153.0))


def joints(first: float) -> NDArray[np.float64]:
    return np.array([first, 0.0, 0.0, 0.0, 0.0, 1.0])


def shown(store: Demonstrations, action: str | None = "close_gripper", subtasks: str = "ab") -> Demonstration:
    """Two subtasks: at 0.1 (key), 0.2, goal 0.5; the second at 1.1, ..."""
    demonstration = store.begin("grasp", "cup")
    for number, subtask in enumerate(subtasks):
        for at, goal, key in ((0.1, False, True), (0.5, True, False), (0.2, False, False)):
            store.observe(demonstration.id, subtask, FOUND, joints(number + at), 1.0, goal=goal, key=key)
    if action == "close_gripper":
        store.act(demonstration.id, "a", "close_gripper")
    return store.finish(demonstration.id)


def test_every_observation_points_to_its_subtasks_goal_in_its_own_demonstration() -> None:
    store = Demonstrations()
    one, two = shown(store), shown(store)
    taught = pairs([one, two], common_subtasks([one, two]), key_only=False)
    assert taught.inputs.shape == (12, 10)
    np.testing.assert_allclose(taught.inputs[0], [0, 10.0, -20.0, -3.0, 0.1, 0, 0, 0, 0, 1.0])
    np.testing.assert_allclose(taught.inputs[3], [1, 10.0, -20.0, -3.0, 1.1, 0, 0, 0, 0, 1.0])
    np.testing.assert_allclose(taught.outputs[:, 0], [0.4, 0.0, 0.3] * 4)
    np.testing.assert_allclose(taught.outputs[:, 1:], 0.0)
    assert taught.demonstrations == ("grasp-1",) * 6 + ("grasp-2",) * 6


def test_the_thesiss_variant_keeps_the_bare_pairs_only() -> None:
    demonstration = shown(Demonstrations())
    taught = pairs([demonstration], demonstration.subtasks, key_only=True)
    np.testing.assert_allclose(taught.inputs[:, 4], [0.1, 1.1])
    np.testing.assert_allclose(taught.outputs[:, 0], [0.4, 0.4])


def test_a_recorded_observation_does_not_change_with_the_callers_array() -> None:
    store = Demonstrations()
    at = joints(0.3)
    observation = store.observe(store.begin("t", "o").id, "a", FOUND, at, 0.0, goal=True, key=True)
    at[0] = 9.0
    assert observation.joints[0] == pytest.approx(0.3)


def test_without_key_observations_the_thesiss_variant_is_refused() -> None:
    store = Demonstrations()
    demonstration = store.begin("grasp", "cup")
    store.observe(demonstration.id, "a", FOUND, joints(0.0), 0.0, goal=True, key=False)
    with pytest.raises(NotTeachable, match="'a'"):
        pairs([demonstration], demonstration.subtasks, key_only=True)


@pytest.mark.parametrize(("action", "subtasks"), [(None, "ab"), ("close_gripper", "ba"), ("close_gripper", "a")])
def test_demonstrations_that_disagree_are_named(action: str | None, subtasks: str) -> None:
    store = Demonstrations()
    with pytest.raises(NotTeachable, match=r"'grasp-1' and 'grasp-2' disagree.*a \(close_gripper\), b"):
        common_subtasks([shown(store), shown(store, action, subtasks)])


def test_only_finished_demonstrations_of_the_task_train_it() -> None:
    store = Demonstrations()
    tasks = Tasks()
    with pytest.raises(NotFound, match="no finished demonstration"):
        tasks.train("grasp", store.finished("grasp"), TrainRequest())
    shown(store)
    store.begin("grasp", "cup")
    store.begin("pour", "cup")
    statistics = tasks.train("grasp", store.finished("grasp"), TrainRequest())
    assert statistics.demonstrations == ("grasp-1",)
    assert statistics.pairs == 6
    assert [(s.name, s.action, s.pairs) for s in statistics.subtasks] == [("a", "close_gripper", 3), ("b", None, 3)]
    assert [s.name for s in tasks.get("grasp").subtasks] == ["a", "b"]


def test_answers_come_from_the_asked_subtask() -> None:
    store = Demonstrations()
    tasks = Tasks()
    for _ in range(3):
        shown(store)
    tasks.train("grasp", store.finished("grasp"), TrainRequest(approximator="nearest"))
    turn, answer = tasks.get("grasp").answer("b", FOUND, joints(0.1))  # where only 'a' was shown
    assert turn.angles[0] == pytest.approx(0.4)
    assert answer.neighbours[0].demonstration == "grasp-1"
    assert answer.support < 1.0


def test_an_approximator_is_named_or_given_with_its_settings() -> None:
    assert declare("kndb").approximator.method == "kndb"
    assert declare("kndb").approximator == ijs.APPROXIMATORS["kndb"]
    own = ApproximatorSettings(method="kndb2", neighbours=4)
    assert declare(own).approximator == own
    with pytest.raises(ValueError, match="approximator"):
        TrainRequest.model_validate({"approximator": "guess"})


def test_the_order_of_the_subtasks_is_that_of_their_first_observation() -> None:
    store = Demonstrations()
    demonstration = store.begin("grasp", "cup")
    for subtask in ("approach", "grasp", "approach"):
        store.observe(demonstration.id, subtask, FOUND, joints(0.0), 0.0, goal=False, key=False)
    assert demonstration.subtask_names == ("approach", "grasp")
    with pytest.raises(Incomplete, match="'approach', 'grasp'"):
        store.finish(demonstration.id)
