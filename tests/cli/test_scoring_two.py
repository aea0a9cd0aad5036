"""The referee of tasks with two objects, on made-up histories."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from handeye.simulation.objects import CUPS, JAR, STAND
from handeye.simulation.pose import Pose
from handeye.simulation.scene import ObjectState, WorldState
from handeye.simulation.scoring_two import PourScore, score_pour, score_stack

CUP = CUPS["blue cup"]
TABLE = CUP.height / 2
ABOVE = JAR.height + 0.05 + CUP.height / 2
ENDED = {"approach": 1.0, "grasp": 2.0, "delivery": 3.0, "pour": 4.0, "replace": 5.0}
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
TIPPED = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
IN_JAR, IN_CUP, SPILLED = (0.5, 0.15, 0.02), (0.5, -0.01, 0.02), (0.3, 0.3, 0.006)


def state(time: float, cup: tuple[float, float, float], *, held: bool = False, opening: float = 0.09) -> WorldState:
    """Cup and jar at one time; the hand is 8 cm before the cup, ready to grasp it."""
    tool = np.eye(4)
    tool[:3, :3] = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # approaches along +x
    tool[:3, 3] = np.array(cup) - [0.0 if held else 0.08, 0.0, 0.0]
    return WorldState(
        world_time=time,
        scene_version=1,
        joints=np.zeros(6),
        fingers=np.full(2, opening / 2),
        tool=Pose.from_matrix(tool),
        objects=(
            ObjectState(CUP.name, Pose(np.array(cup), LEVEL), held, held),
            ObjectState(JAR.name, Pose(np.array([0.5, 0.15, JAR.height / 2]), LEVEL), False, False),
        ),
        liquid=np.array([IN_CUP] * 4),
    )


def history(arrived: int = 4) -> list[WorldState]:
    """A trial in which everything goes well, and so many of four particles arrive."""
    states = [
        state(0.0, (0.5, -0.15, TABLE)),
        state(1.0, (0.5, -0.15, TABLE)),
        state(2.0, (0.5, -0.15, TABLE), held=True, opening=0.065),
        state(3.0, (0.5, 0.08, ABOVE), held=True, opening=0.065),
        state(4.0, (0.5, 0.08, ABOVE), held=True, opening=0.065),
        state(5.0, (0.5, -0.01, TABLE)),
    ]
    liquid = np.array([IN_JAR] * arrived + [SPILLED] * (4 - arrived))
    states[-1] = replace(states[-1], liquid=liquid)
    return states


def judged(states: list[WorldState], ended: dict[str, float] = ENDED) -> PourScore:
    return score_pour(states, CUP, JAR, ended)


def changed(states: list[WorldState], index: int, name: str, **changes: Any) -> list[WorldState]:
    """The history with another pose or touch of an object at one moment."""
    objects = tuple(replace(each, **changes) if each.name == name else each for each in states[index].objects)
    return [*states[:index], replace(states[index], objects=objects), *states[index + 1 :]]


def test_what_goes_well_passes() -> None:
    found = judged(history())
    assert found.passed == dict.fromkeys(ENDED, True)
    assert (found.arrived, found.left, found.spilled) == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(("arrived", "passed"), [(3, True), (2, False), (0, False)])
def test_more_than_half_has_to_arrive(arrived: int, passed: bool) -> None:
    found = judged(history(arrived))
    assert found.passed["pour"] is passed
    assert (found.arrived, found.spilled) == (arrived / 4, 1 - arrived / 4)


def test_what_stays_in_the_cup_is_neither_spilled_nor_arrived() -> None:
    states = history()
    states[-1] = replace(states[-1], liquid=np.array([IN_JAR, IN_JAR, IN_JAR, IN_CUP]))
    found = judged(states)
    assert (found.arrived, found.left, found.spilled) == (0.75, 0.25, 0.0)


@pytest.mark.parametrize("subtask", list(ENDED))
def test_a_subtask_that_was_not_completed_has_not_passed(subtask: str) -> None:
    ended = {name: time for name, time in ENDED.items() if name != subtask}
    assert judged(history(), ended).passed == {name: name != subtask for name in ENDED}


@pytest.mark.parametrize(
    ("index", "name", "changes", "failed"),
    [
        (3, CUP.name, {"touches_finger_1": False}, {"delivery"}),
        (3, CUP.name, {"pose": Pose(np.array([0.5, 0.08, ABOVE]), TIPPED)}, {"delivery"}),
        (3, CUP.name, {"pose": Pose(np.array([0.5, 0.08, 0.10]), LEVEL)}, {"delivery"}),
        (3, CUP.name, {"pose": Pose(np.array([0.5, 0.04, ABOVE]), LEVEL)}, {"delivery"}),
        (3, JAR.name, {"pose": Pose(np.array([0.52, 0.15, 0.045]), LEVEL)}, {"delivery"}),
        (5, JAR.name, {"pose": Pose(np.array([0.5, 0.15, 0.045]), TIPPED)}, {"pour"}),
        (5, CUP.name, {"touches_finger_2": True}, {"replace"}),
        (5, CUP.name, {"pose": Pose(np.array([0.5, -0.01, TABLE]), TIPPED)}, {"replace"}),
        (5, CUP.name, {"pose": Pose(np.array([0.5, -0.01, TABLE + 0.01]), LEVEL)}, {"replace"}),
        (5, CUP.name, {"pose": Pose(np.array([0.5, -0.15, TABLE]), LEVEL)}, {"replace"}),
    ],
)
def test_each_condition_counts(index: int, name: str, changes: dict[str, Any], failed: set[str]) -> None:
    found = judged(changed(history(), index, name, **changes))
    assert {subtask for subtask, passed in found.passed.items() if not passed} == failed


ON_STAND = STAND.height + CUP.height / 2
STACKED = {"approach": 1.0, "grasp": 2.0, "carry": 3.0, "put": 4.0}


def stacking() -> list[WorldState]:
    """A trial in which the cup is put on the stand; it stands where the jar does else."""
    return [
        _with_stand(each)
        for each in (
            state(0.0, (0.5, -0.15, TABLE)),
            state(1.0, (0.5, -0.15, TABLE)),
            state(2.0, (0.5, -0.15, TABLE), held=True, opening=0.065),
            state(3.0, (0.5, 0.15, ON_STAND + 0.1), held=True, opening=0.065),
            state(4.0, (0.5, 0.155, ON_STAND)),
        )
    ]


def _with_stand(there: WorldState) -> WorldState:
    cup = there.objects[0]
    stand = ObjectState(STAND.name, Pose(np.array([0.5, 0.15, STAND.height / 2]), LEVEL), False, False)
    return replace(there, objects=(cup, stand))


def test_a_cup_on_the_stand_passes() -> None:
    assert score_stack(stacking(), CUP, STAND, STACKED) == dict.fromkeys(STACKED, True)


@pytest.mark.parametrize(
    ("index", "name", "changes", "failed"),
    [
        (3, CUP.name, {"touches_finger_1": False}, {"carry"}),
        (3, CUP.name, {"pose": Pose(np.array([0.5, 0.05, ON_STAND + 0.1]), LEVEL)}, {"carry"}),
        (4, CUP.name, {"touches_finger_1": True}, {"put"}),
        (4, CUP.name, {"pose": Pose(np.array([0.5, 0.18, ON_STAND]), LEVEL)}, {"put"}),
        (4, CUP.name, {"pose": Pose(np.array([0.5, 0.15, TABLE]), LEVEL)}, {"put"}),
        (4, CUP.name, {"pose": Pose(np.array([0.5, 0.15, ON_STAND]), TIPPED)}, {"put"}),
        (4, STAND.name, {"pose": Pose(np.array([0.5, 0.165, STAND.height / 2]), LEVEL)}, {"put"}),
    ],
)
def test_each_condition_of_stacking_counts(index: int, name: str, changes: dict[str, Any], failed: set[str]) -> None:
    found = score_stack(changed(stacking(), index, name, **changes), CUP, STAND, STACKED)
    assert {subtask for subtask, passed in found.items() if not passed} == failed


def test_stacking_that_was_not_completed_has_not_passed() -> None:
    assert score_stack(stacking(), CUP, STAND, {}) == dict.fromkeys(STACKED, False)
