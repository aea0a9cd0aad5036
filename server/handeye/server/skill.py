"""What a run asks: a task's subtasks in order, and in each of them how the joints are to turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from handeye.modules.answers import Answer
from handeye.modules.spaces import ImagePair, JointDifference
from handeye.robot_bridge.driver import Joints
from handeye.server.demonstration import Subtask


@dataclass(frozen=True, slots=True)
class SkillAnswer:
    """How far each joint is to turn, and module IJS's answer that it was taken from."""

    turn: JointDifference
    answer: Answer
    seen: float
    """Support of module CSS's answers for where object and hand are, the least of them; 1 where it was not asked."""

    @property
    def support(self) -> float:
        """1: amid what was taught; towards 0: outside of it, for one of the modules that were asked."""
        return min(self.answer.support, self.seen)


class Skill(Protocol):
    """A trained task: its subtasks in order, and the answers of its modules."""

    @property
    def subtasks(self) -> Sequence[Subtask]:
        """In the order in which they are done."""
        ...

    def answer(self, subtask: str, found: ImagePair, joints: Joints, waypoint: int | None = None) -> SkillAnswer:
        """The way towards the subtask's goal.

        With `waypoint`, a number, towards that of the subtask's way-points.
        """
        ...
