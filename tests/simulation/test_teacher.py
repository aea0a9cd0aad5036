"""The teacher leads the hand as the lesson says, however clumsily."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from handeye.client import ApiError
from handeye.robot_bridge.driver import unwatched
from handeye.simulation import grasping, kinematics
from handeye.simulation.lessons import grasp
from handeye.simulation.objects import CUPS
from handeye.simulation.places import Place
from handeye.simulation.pose import Pose
from handeye.simulation.scatter import CLUMSY, STEADY, Clumsiness
from handeye.simulation.scene import ObjectState, WorldState
from handeye.simulation.teacher import Teacher

CUP = CUPS["blue cup"]
PLACE = Place(0.55, 0.05, 0.3, 1)
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


class Arm:
    """Goes where it is led, and notes it."""

    def __init__(self) -> None:
        self.joints = grasping.PARK
        self.time = 0.0
        self.done: list[Any] = []

    def lease(self) -> nullcontext[None]:
        return nullcontext()

    def state(self) -> SimpleNamespace:
        return SimpleNamespace(joints=self.joints, world_time=self.time, still_since=0.0)

    def advance(self, duration: float, _watch: object) -> SimpleNamespace:
        self.time += duration
        return self.state()

    def move_to_joints(self, joints: np.ndarray[Any, Any], *_: object) -> None:
        self.joints = joints
        self.done.append(joints)

    def close_gripper(self, _watch: object) -> None:
        self.done.append("close")


class Client:
    """Notes the goals that it is shown."""

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        self.goals: dict[str, np.ndarray[Any, Any]] = {}
        self.hidden: set[bool] = set()
        """Looks of the approach that see nothing: those at its goal (True), others (False); not where it begins."""
        self.deleted: list[str] = []

    def begin_demonstration(self, _task: str, _object: str) -> SimpleNamespace:
        return SimpleNamespace(id="grasp-1")

    def observe(self, _id: str, subtask: str, *, object_name: str | None, goal: bool, key: bool) -> None:
        if subtask == "approach" and goal in self.hidden and not key:
            raise ApiError(422, "Unprocessable Entity", "the cup is not seen", "not_seen")
        if goal:
            self.goals[subtask] = self.arm.joints

    def add_waypoint(self, _id: str, _subtask: str) -> None:
        """Of no interest here."""

    def mark_action(self, _id: str, _subtask: str, _action: str) -> None:
        """Of no interest here."""

    def delete_demonstration(self, demonstration: str) -> None:
        self.deleted.append(demonstration)

    def finish_demonstration(self, _id: str) -> None:
        """Of no interest here."""


def world() -> WorldState:
    cup = ObjectState(CUP.name, Pose(np.array([PLACE.x, PLACE.y, CUP.height / 2]), UPRIGHT), False, False)
    return WorldState(0.0, 1, grasping.PARK, np.full(2, 0.045), Pose(np.zeros(3), UPRIGHT), (cup,))


def demonstrate(arm: Arm, client: Client, clumsiness: Clumsiness = STEADY) -> None:
    lab = SimpleNamespace(reset=lambda _seed: None, place=lambda *_: None, world=world)
    teacher = Teacher(cast(Any, arm), cast(Any, lab), cast(Any, client), grasp(CUP), "grasp", unwatched, clumsiness)
    teacher.demonstrate((PLACE,), np.random.default_rng(3), lambda: None)


@pytest.mark.parametrize(("clumsiness", "least", "most"), [(STEADY, -1.0, 1e-9), (CLUMSY, 0.002, 0.02)])
def test_how_far_off_a_teacher_grasps_and_that_what_is_held_is_only_lifted(
    clumsiness: Clumsiness, least: float, most: float
) -> None:
    arm = Arm()
    client = Client(arm)
    demonstrate(arm, client, clumsiness)
    meant = grasping.solve_chain(np.array([PLACE.x, PLACE.y]), height=CUP.height / 2)
    miss = kinematics.forward(client.goals["grasp"])[:3, 3] - kinematics.forward(meant["grasp"])[:3, 3]
    assert least < np.linalg.norm(miss) < most
    assert client.goals["lift"] is client.goals["grasp"]
    (lifted,) = arm.done[[isinstance(each, str) for each in arm.done].index(True) + 1 :]
    assert np.array_equal(client.goals["hold"], lifted)
    assert np.array_equal(lifted, meant["lift"])


def test_what_the_hand_hides_on_the_way_is_not_recorded() -> None:
    client = Client(Arm())
    client.hidden = {False}
    demonstrate(client.arm, client)
    assert list(client.goals) == ["approach", "grasp", "lift", "hold"]
    assert client.deleted == []


def test_a_demonstration_whose_goal_is_not_seen_is_taken_back() -> None:
    client = Client(Arm())
    client.hidden = {True}
    with pytest.raises(ApiError, match="not seen"):
        demonstrate(client.arm, client)
    assert client.deleted == ["grasp-1"]
