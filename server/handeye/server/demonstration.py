"""A demonstration: what a person with a teach pendant showed, as places in pictures, joints, gripper actions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from handeye.modules.spaces import HeadAngles, ImagePair
from handeye.robot_bridge.driver import Joints

Action = Literal["close_gripper", "open_gripper"]
Outcome = Literal["success", "failure"]


@dataclass(frozen=True, slots=True)
class Observation:
    """One moment of a demonstration: where object and hand were in the pictures, and the joints (rad).

    A way-point is a moment at which nobody looked: the hand passes there after the subtask's goal.
    """

    number: int
    subtask: str
    object: str
    """What the subtask is towards."""
    world_time: float
    """In s: which the left picture shows; of a way-point, at which it was told."""
    found: ImagePair | None
    """None: a way-point."""
    joints: Joints
    goal: bool = False
    key: bool = False
    head: HeadAngles | None = None
    """Where the head pointed, as it says; None: a way-point, or recorded when this was not written down."""
    seconds: float = 0.0
    """Of a way-point: the world time that passed on the way there since the moment before, in s."""


@dataclass(frozen=True, slots=True)
class Subtask:
    """A part of a task: the hand comes to a goal, looking; goes on along a way, without; the gripper acts."""

    name: str
    action: Action | None
    object: str | None = None
    """What it is towards; None: the object that the task is done with."""
    way: tuple[float, ...] = ()
    """World time that passes on the way to each of its way-points, in s; most subtasks have none."""


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
        """The subtasks with their objects, ways and gripper actions, in order."""
        return tuple(self._subtask(name) for name in self.subtask_names)

    def goal(self, subtask: str) -> Observation | None:
        """The observation at the subtask's end; None when it has not been made."""
        return next((o for o in self.observations if o.subtask == subtask and o.goal), None)

    def way(self, subtask: str) -> tuple[Observation, ...]:
        """The subtask's way-points, in order."""
        return tuple(o for o in self.observations if o.subtask == subtask and o.found is None)

    def towards(self, subtask: str) -> str | None:
        """The object that the subtask is towards; None when nothing of it was observed."""
        return next((o.object for o in self.observations if o.subtask == subtask), None)

    def _subtask(self, name: str) -> Subtask:
        towards = self.towards(name)
        seconds = tuple(o.seconds for o in self.way(name))
        return Subtask(name, self.actions.get(name), None if towards == self.object else towards, seconds)
