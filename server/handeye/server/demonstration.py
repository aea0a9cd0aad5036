"""A demonstration: what a person with a teach pendant showed, as places in pictures, joints, gripper actions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from handeye.modules.spaces import ImagePair
from handeye.robot_bridge.driver import Joints

Action = Literal["close_gripper", "open_gripper"]
Outcome = Literal["success", "failure"]


@dataclass(frozen=True, slots=True)
class Observation:
    """One moment of a demonstration: where object and hand were in the pictures, and the joints (rad)."""

    number: int
    subtask: str
    world_time: float
    found: ImagePair
    joints: Joints
    goal: bool
    key: bool


@dataclass(frozen=True, slots=True)
class Subtask:
    """A part of a task that ends in a goal posture, then perhaps in a gripper action."""

    name: str
    action: Action | None


@dataclass(frozen=True, slots=True)
class Demonstration:
    """One shown sequence. `subtasks` are in the order in which they were shown first."""

    id: str
    task: str
    object: str
    observations: tuple[Observation, ...]
    actions: Mapping[str, Action]
    finished: bool
    outcome: Outcome | None
    """What a person said of it: failures are not trained from."""
    created: float
    """s since 1970."""

    @property
    def subtask_names(self) -> tuple[str, ...]:
        """The subtasks' names in order."""
        return tuple(dict.fromkeys(observation.subtask for observation in self.observations))

    @property
    def subtasks(self) -> tuple[Subtask, ...]:
        """The subtasks with their gripper actions, in order."""
        return tuple(Subtask(name, self.actions.get(name)) for name in self.subtask_names)

    def goal(self, subtask: str) -> Observation | None:
        """The observation at the subtask's end; None when it has not been made."""
        return next((o for o in self.observations if o.subtask == subtask and o.goal), None)
