"""Training: pairs from demonstrations, module IJS from pairs, trained tasks from both.

Trained tasks are kept in memory: they do not survive a restart of the coordinator.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from handeye.modules import ijs, pipeline
from handeye.modules.declaration import ApproximatorSettings, ModuleDeclaration
from handeye.modules.module import Answer, CategoryStatistics, Module
from handeye.modules.spaces import ImagePair, JointAngles, JointDifference
from handeye.robot_bridge.driver import Joints
from handeye.server.demonstrations import Demonstration, Subtask
from handeye.server.problem import Conflict, NotFound

Method = Literal["local_quadratic", "local_linear", "kndb", "kndb2", "nearest"]


class TrainRequest(BaseModel):
    """How to train: from which pairs, and how answers are made."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    pairs: Literal["all", "key"] = "all"
    """`key`: only the thesis's bare pairs, one from the beginning of each subtask."""
    approximator: Method | ApproximatorSettings | None = None
    """The method by name, or with its settings; null: module IJS's own."""


class SubtaskStatistics(BaseModel):
    """A trained subtask: what the gripper does at its end, its pairs, and the tree that holds them."""

    name: str
    action: str | None
    pairs: int
    nodes: int
    levels: int


class TrainStatistics(BaseModel):
    """What a task was trained from."""

    task: str
    demonstrations: tuple[str, ...]
    pairs: int
    subtasks: tuple[SubtaskStatistics, ...]
    approximator: ApproximatorSettings


@dataclass(frozen=True, slots=True)
class Pairs:
    """Training pairs of module IJS: inputs (n, 10), outputs (n, joints), and the demonstration of each."""

    inputs: NDArray[np.float64]
    outputs: NDArray[np.float64]
    demonstrations: tuple[str, ...]


class NotTeachable(Conflict):
    """The demonstrations do not make a task."""

    code = "not_teachable"


def common_subtasks(demonstrations: Sequence[Demonstration]) -> tuple[Subtask, ...]:
    """The subtasks and gripper actions, in order; `NotTeachable` when the demonstrations disagree about them."""
    first = demonstrations[0]
    for other in demonstrations[1:]:
        if other.subtasks != first.subtasks:
            raise NotTeachable(
                f"Demonstrations '{first.id}' and '{other.id}' disagree about subtasks or gripper actions: "
                f"{_spelled(first)} against {_spelled(other)}."
            )
    return first.subtasks


def pairs(demonstrations: Sequence[Demonstration], order: Sequence[Subtask], *, key_only: bool) -> Pairs:
    """Every observation towards its subtask's goal in the same demonstration.

    Input: (subtask's number, image vector hand -> object, joints); output: goal joints - joints of the observation.
    With `key_only` only the observations marked as the thesis's bare pairs.
    """
    numbers = {subtask.name: number for number, subtask in enumerate(order)}
    inputs, outputs, sources = [], [], []
    for demonstration in demonstrations:
        goals = {name: demonstration.goal(name) for name in numbers}
        for observation in demonstration.observations:
            goal = goals[observation.subtask]
            if goal is None or (key_only and not observation.key):  # finished demonstrations have all their goals
                continue
            action = pipeline.specify_action(observation.found)
            inputs.append(ijs.input_vector(numbers[observation.subtask], action, JointAngles(observation.joints)))
            outputs.append(goal.joints - observation.joints)
            sources.append(demonstration.id)
    if without := set(numbers.values()) - {int(row[0]) for row in inputs}:
        names = ", ".join(f"'{order[number].name}'" for number in sorted(without))
        raise NotTeachable(f'There is no pair to train {names} from: no observation there is marked with "key".')
    return Pairs(np.array(inputs), np.array(outputs), tuple(sources))


class TrainedTask:
    """A task that was taught: its subtasks in order, and module IJS, which answers in each of them."""

    def __init__(self, subtasks: tuple[Subtask, ...], declaration: ModuleDeclaration, taught: Pairs) -> None:
        self.subtasks = subtasks
        self._numbers = {subtask.name: number for number, subtask in enumerate(subtasks)}
        self._module = Module(declaration)
        self.statistics = self._module.train(taught.inputs, taught.outputs, taught.demonstrations)

    def answer(self, subtask: str, found: ImagePair, joints: Joints) -> tuple[JointDifference, Answer]:
        """ASM and IJS: how far each joint is to turn towards the goal of `subtask`, and where that comes from."""
        action = pipeline.specify_action(found)
        return pipeline.image_to_joints(self._module, self._numbers[subtask], action, JointAngles(joints))


class Tasks:
    """The trained tasks by name. Safe among threads."""

    def __init__(self) -> None:
        self._tasks: dict[str, TrainedTask] = {}
        self._lock = threading.Lock()

    def train(self, name: str, demonstrations: Sequence[Demonstration], request: TrainRequest) -> TrainStatistics:
        """Trains task `name` from finished demonstrations; an earlier training of it is replaced.

        `NotFound` without demonstrations; `NotTeachable` when they do not make a task.
        """
        if not demonstrations:
            raise NotFound(f"There is no finished demonstration of task '{name}'; show it by POST /v1/demonstrations.")
        subtasks = common_subtasks(demonstrations)
        declaration = declare(request.approximator)
        task = TrainedTask(subtasks, declaration, pairs(demonstrations, subtasks, key_only=request.pairs == "key"))
        with self._lock:
            self._tasks[name] = task
        return TrainStatistics(
            task=name,
            demonstrations=tuple(demonstration.id for demonstration in demonstrations),
            pairs=sum(learned.samples for learned in task.statistics),
            subtasks=tuple(map(_subtask_statistics, subtasks, task.statistics)),
            approximator=declaration.approximator,
        )

    def get(self, name: str) -> TrainedTask:
        """The trained task of that name; `NotFound` when there is none."""
        with self._lock:
            task = self._tasks.get(name)
            known = ", ".join(map(repr, self._tasks)) or "none yet"
        if task is None:
            raise NotFound(f"Task '{name}' is not trained (trained: {known}); train it by POST /v1/tasks/{name}/train.")
        return task


def declare(approximator: Method | ApproximatorSettings | None) -> ModuleDeclaration:
    """Module IJS with this approximator; a method by name comes with the settings that suit IJS."""
    if approximator is None:
        return ijs.DECLARATION
    if isinstance(approximator, str):
        approximator = ijs.APPROXIMATORS[approximator]
    return ijs.DECLARATION.model_copy(update={"approximator": approximator})


def _subtask_statistics(subtask: Subtask, learned: CategoryStatistics) -> SubtaskStatistics:
    return SubtaskStatistics(
        name=subtask.name,
        action=subtask.action,
        pairs=learned.samples,
        nodes=learned.tree.nodes,
        levels=learned.tree.levels,
    )


def _spelled(demonstration: Demonstration) -> str:
    return ", ".join(s.name + (f" ({s.action})" if s.action else "") for s in demonstration.subtasks)
