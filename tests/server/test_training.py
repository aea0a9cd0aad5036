"""Pairs from demonstrations."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from handeye.modules import css, ijs
from handeye.modules.declaration import ApproximatorSettings
from handeye.modules.spaces import HandPoint, ImagePair, ImagePoint
from handeye.server.answering import NothingTaught
from handeye.server.demonstration import Demonstration
from handeye.server.demonstrations import Demonstrations, Incomplete
from handeye.server.livemodules import LiveModules
from handeye.server.pairs import NotTeachable, pairs
from handeye.server.problem import Conflict, NotFound
from handeye.server.store import Store
from handeye.server.training import Tasks, TrainRequest, common_subtasks, declare

if TYPE_CHECKING:
    from numpy.typing import NDArray

FOUND = ImagePair(object=ImagePoint(200.0, 300.0, 150.0), hand=ImagePoint(190.0, 320.0, 153.0))


@pytest.fixture
def recorded(store: Store) -> Demonstrations:
    return Demonstrations(store)


@pytest.fixture
def modules(store: Store) -> LiveModules:
    live = LiveModules(store)
    live.load()
    return live


@pytest.fixture
def tasks(store: Store, modules: LiveModules) -> Tasks:
    return Tasks(store, modules)


def joints(first: float) -> NDArray[np.float64]:
    return np.array([first, 0.0, 0.0, 0.0, 0.0, 1.0])


def shown(recorded: Demonstrations, action: str | None = "close_gripper", subtasks: str = "ab") -> Demonstration:
    """Two subtasks: at 0.1 (key), 0.2, goal 0.5; the second at 1.1, ..."""
    demonstration = recorded.begin("grasp", "cup")
    for number, subtask in enumerate(subtasks):
        for at, goal, key in ((0.1, False, True), (0.5, True, False), (0.2, False, False)):
            recorded.observe(demonstration.id, subtask, FOUND, joints(number + at), 1.0, goal=goal, key=key)
    if action == "close_gripper":
        recorded.act(demonstration.id, "a", "close_gripper")
    return recorded.finish(demonstration.id)


def test_every_observation_points_to_its_subtasks_goal_in_its_own_demonstration(recorded: Demonstrations) -> None:
    one, two = shown(recorded), shown(recorded)
    taught = pairs([one, two], common_subtasks([one, two]), key_only=False)
    assert taught.inputs.shape == (12, 10)
    np.testing.assert_allclose(taught.inputs[0], [0, 10.0, -20.0, -3.0, 0.1, 0, 0, 0, 0, 1.0])
    np.testing.assert_allclose(taught.inputs[3], [1, 10.0, -20.0, -3.0, 1.1, 0, 0, 0, 0, 1.0])
    np.testing.assert_allclose(taught.outputs[:, 0], [0.4, 0.0, 0.3] * 4)
    np.testing.assert_allclose(taught.outputs[:, 1:], 0.0)
    assert taught.demonstrations == ("grasp-1",) * 6 + ("grasp-2",) * 6


def test_the_thesiss_variant_keeps_the_bare_pairs_only(recorded: Demonstrations) -> None:
    demonstration = shown(recorded)
    taught = pairs([demonstration], demonstration.subtasks, key_only=True)
    np.testing.assert_allclose(taught.inputs[:, 4], [0.1, 1.1])
    np.testing.assert_allclose(taught.outputs[:, 0], [0.4, 0.4])


def test_a_recorded_observation_does_not_change_with_the_callers_array(recorded: Demonstrations) -> None:
    at = joints(0.3)
    observation = recorded.observe(recorded.begin("t", "o").id, "a", FOUND, at, 0.0, goal=True, key=True)
    at[0] = 9.0
    assert observation.joints[0] == pytest.approx(0.3)


def test_without_key_observations_the_thesiss_variant_is_refused(recorded: Demonstrations) -> None:
    demonstration = recorded.begin("grasp", "cup")
    recorded.observe(demonstration.id, "a", FOUND, joints(0.0), 0.0, goal=True, key=False)
    shown_so_far = recorded.get(demonstration.id)
    with pytest.raises(NotTeachable, match="'a'"):
        pairs([shown_so_far], shown_so_far.subtasks, key_only=True)


@pytest.mark.parametrize(("action", "subtasks"), [(None, "ab"), ("close_gripper", "ba"), ("close_gripper", "a")])
def test_demonstrations_that_disagree_are_named(recorded: Demonstrations, action: str | None, subtasks: str) -> None:
    with pytest.raises(NotTeachable, match=r"'grasp-1' and 'grasp-2' disagree.*a \(close_gripper\), b"):
        common_subtasks([shown(recorded), shown(recorded, action, subtasks)])


def test_only_finished_demonstrations_of_the_task_train_it(recorded: Demonstrations, tasks: Tasks) -> None:
    with pytest.raises(NotFound, match="no finished demonstration"):
        tasks.train("grasp", recorded.trainable("grasp"), TrainRequest())
    shown(recorded)
    recorded.begin("grasp", "cup")
    recorded.begin("pour", "cup")
    statistics = tasks.train("grasp", recorded.trainable("grasp"), TrainRequest())
    assert statistics.demonstrations == ("grasp-1",)
    assert statistics.pairs == 6
    assert [(s.name, s.action, s.pairs) for s in statistics.subtasks] == [("a", "close_gripper", 3), ("b", None, 3)]
    assert [s.name for s in tasks.get("grasp").subtasks] == ["a", "b"]


def test_answers_come_from_the_asked_subtask(recorded: Demonstrations, tasks: Tasks) -> None:
    for _ in range(3):
        shown(recorded)
    tasks.train("grasp", recorded.trainable("grasp"), TrainRequest(approximator="nearest"))
    told = tasks.get("grasp").answer("b", FOUND, joints(0.1))  # where only 'a' was shown
    assert told.turn.angles[0] == pytest.approx(0.4)
    assert told.answer.neighbours[0].demonstration == "grasp-1"
    assert told.support == told.answer.support < 1.0


def test_an_approximator_is_named_or_given_with_its_settings() -> None:
    assert declare("picture", "kndb").approximator.method == "kndb"
    assert declare("picture", "kndb").approximator == ijs.APPROXIMATORS["kndb"]
    own = ApproximatorSettings(method="kndb2", neighbours=4)
    assert declare("picture", own).approximator == own
    with pytest.raises(ValueError, match="approximator"):
        TrainRequest.model_validate({"approximator": "guess"})


def test_the_order_of_the_subtasks_is_that_of_their_first_observation(recorded: Demonstrations) -> None:
    demonstration = recorded.begin("grasp", "cup")
    for subtask in ("approach", "grasp", "approach"):
        recorded.observe(demonstration.id, subtask, FOUND, joints(0.0), 0.0, goal=False, key=False)
    assert recorded.get(demonstration.id).subtask_names == ("approach", "grasp")
    with pytest.raises(Incomplete, match="'approach', 'grasp'"):
        recorded.finish(demonstration.id)


CORNERS = tuple((200.0 + row, 300.0 + column, 150.0) for row, column in ((-9, -9), (-9, 9), (9, 9), (9, -9)))
OUTLINED = ImagePair(object=FOUND.object, hand=HandPoint(190.0, 320.0, 153.0, CORNERS))


def outlined(recorded: Demonstrations) -> None:
    """A demonstration in which the hand was always seen with its outline."""
    demonstration = recorded.begin("grasp", "cup")
    for at, goal in ((0.1, False), (0.5, True)):
        recorded.observe(demonstration.id, "a", OUTLINED, joints(at), 1.0, goal=goal, key=True)
    recorded.finish(demonstration.id)


def teach_css(modules: LiveModules) -> None:
    """Metric enough: what is far apart in the picture is far apart in space."""
    modules.create(css.DECLARATION)
    rows = np.random.default_rng(0).uniform([100.0, 200.0, 100.0], [300.0, 400.0, 200.0], (200, 3))
    modules.add("CSS", rows, (rows - 200.0) / 600.0, [None] * len(rows))


def test_with_css_the_way_is_told_in_the_hands_axes(
    recorded: Demonstrations, tasks: Tasks, modules: LiveModules
) -> None:
    outlined(recorded)
    assert tasks.train("grasp", recorded.trainable("grasp"), TrainRequest()).frame == "picture"
    teach_css(modules)
    assert tasks.train("grasp", recorded.trainable("grasp"), TrainRequest()).frame == "hand"
    trained = tasks.get("grasp")
    assert trained.frame == "hand"
    assert [each.name for each in tasks.module(trained).declaration.inputs[1:4]] == ["right", "up", "out"]
    told = trained.answer("a", OUTLINED, joints(0.5))
    assert np.isfinite(told.turn.angles).all()
    assert 0.2 < told.support <= told.seen < 1.0
    beyond = replace(OUTLINED, object=ImagePoint(-4000.0, 9000.0, 1.0))
    assert trained.answer("a", beyond, joints(0.5)).seen < 0.01  # where CSS was taught nothing
    assert tasks.train("grasp", recorded.trainable("grasp"), TrainRequest(frame="picture")).frame == "picture"
    with pytest.raises(Conflict, match="other subtasks or axes"):
        trained.answer("a", OUTLINED, joints(0.5))  # metres would be taken for pixels
    modules.delete("CSS")
    with pytest.raises(NothingTaught, match="collect CSS"):
        tasks.train("grasp", recorded.trainable("grasp"), TrainRequest(frame="hand"))


def test_hands_that_were_seen_as_points_have_no_axes(
    recorded: Demonstrations, tasks: Tasks, modules: LiveModules
) -> None:
    shown(recorded)
    teach_css(modules)
    assert tasks.train("grasp", recorded.trainable("grasp"), TrainRequest()).frame == "picture"
    with pytest.raises(NotTeachable, match="point only"):
        tasks.train("grasp", recorded.trainable("grasp"), TrainRequest(frame="hand"))
