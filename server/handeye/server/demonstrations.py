"""Demonstrations: what a person with a teach pendant shows, as pictures, joint readings and gripper actions.

The teacher moves the robot; the coordinator watches. It keeps what it recognised in each stereo pair and the joints,
not the pictures. Demonstrations are kept in memory: they do not survive a restart of the coordinator.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from handeye.modules.spaces import ImagePair
from handeye.robot_bridge.driver import Joints
from handeye.server.problem import Conflict, NotFound

Action = Literal["close_gripper", "open_gripper"]


class Incomplete(Conflict):
    """A demonstration lacks something that training needs."""

    code = "incomplete"


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


@dataclass
class Demonstration:
    """One shown sequence. `subtasks` are in the order in which they were shown first."""

    id: str
    task: str
    object: str
    observations: list[Observation] = field(default_factory=list)
    actions: dict[str, Action] = field(default_factory=dict)
    finished: bool = False

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


class Demonstrations:
    """Records demonstrations and keeps them. Safe among threads."""

    def __init__(self) -> None:
        self._demonstrations: dict[str, Demonstration] = {}
        self._lock = threading.Lock()

    def begin(self, task: str, object_name: str) -> Demonstration:
        """A new, empty demonstration; its id is '<task>-<n>' with n counting the task's demonstrations from 1."""
        with self._lock:
            number = 1 + sum(d.task == task for d in self._demonstrations.values())
            demonstration = Demonstration(f"{task}-{number}", task, object_name)
            self._demonstrations[demonstration.id] = demonstration
            return demonstration

    def get(self, demonstration_id: str) -> Demonstration:
        """The demonstration of that id; `NotFound` when there is none."""
        with self._lock:
            return self._get(demonstration_id)

    def all(self) -> tuple[Demonstration, ...]:
        """Every demonstration, in the order they were begun."""
        with self._lock:
            return tuple(self._demonstrations.values())

    def finished(self, task: str) -> tuple[Demonstration, ...]:
        """The finished demonstrations of a task, in the order they were begun."""
        return tuple(d for d in self.all() if d.task == task and d.finished)

    def recordable(self, demonstration_id: str, subtask: str, *, goal: bool) -> Demonstration:
        """The demonstration, if an observation of `subtask` may be added to it now.

        `Conflict` when it is finished, or when `goal` and the subtask already has its goal.
        """
        with self._lock:
            return self._recordable(demonstration_id, subtask, goal=goal)

    def observe(
        self,
        demonstration_id: str,
        subtask: str,
        found: ImagePair,
        joints: NDArray[np.float64],
        world_time: float,
        *,
        goal: bool,
        key: bool,
    ) -> Observation:
        """Adds an observation; raises as `recordable` does."""
        with self._lock:
            demonstration = self._recordable(demonstration_id, subtask, goal=goal)
            number = len(demonstration.observations)
            observation = Observation(number, subtask, world_time, found, joints.copy(), goal, key)
            demonstration.observations.append(observation)
            return observation

    def act(self, demonstration_id: str, subtask: str, action: Action) -> Demonstration:
        """Marks what the person did with the gripper at the end of a subtask."""
        with self._lock:
            demonstration = self._open(demonstration_id)
            if subtask not in demonstration.subtask_names:
                raise Conflict(
                    f"Demonstration '{demonstration_id}' has no observation of subtask '{subtask}' yet; "
                    "record the subtask first, then its action."
                )
            if before := demonstration.actions.get(subtask):
                raise Conflict(f"Subtask '{subtask}' already ends with '{before}'; a subtask has one action.")
            demonstration.actions[subtask] = action
            return demonstration

    def finish(self, demonstration_id: str) -> Demonstration:
        """Closes a complete demonstration for training; `Incomplete` says what is missing."""
        with self._lock:
            demonstration = self._open(demonstration_id)
            if not demonstration.observations:
                raise Incomplete(f"Demonstration '{demonstration_id}' is empty; record observations first.")
            without_goal = [name for name in demonstration.subtask_names if demonstration.goal(name) is None]
            if without_goal:
                raise Incomplete(
                    f"Demonstration '{demonstration_id}' has no goal for {', '.join(map(repr, without_goal))}; record "
                    'one observation with "goal": true where each subtask ends.'
                )
            demonstration.finished = True
            return demonstration

    def _get(self, demonstration_id: str) -> Demonstration:
        try:
            return self._demonstrations[demonstration_id]
        except KeyError:
            raise NotFound(
                f"There is no demonstration '{demonstration_id}'; begin one by POST /v1/demonstrations."
            ) from None

    def _open(self, demonstration_id: str) -> Demonstration:
        demonstration = self._get(demonstration_id)
        if demonstration.finished:
            raise Conflict(f"Demonstration '{demonstration_id}' is finished; begin a new one.")
        return demonstration

    def _recordable(self, demonstration_id: str, subtask: str, *, goal: bool) -> Demonstration:
        demonstration = self._open(demonstration_id)
        if goal and (before := demonstration.goal(subtask)):
            raise Conflict(
                f"Subtask '{subtask}' of demonstration '{demonstration_id}' already has its goal "
                f"(observation {before.number})."
            )
        return demonstration
