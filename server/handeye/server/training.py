"""Training: pairs from demonstrations, module IJS from pairs, trained tasks from both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict
from sqlalchemy import Connection

from handeye.modules import ijs, pipeline
from handeye.modules.answers import CategoryStatistics
from handeye.modules.asm import Frame
from handeye.modules.css import DECLARATION as CSS
from handeye.modules.declaration import ApproximatorSettings, ModuleDeclaration
from handeye.modules.module import Module
from handeye.modules.spaces import HandPoint, HandVector, ImagePair, JointAngles
from handeye.robot_bridge.driver import Joints
from handeye.rpt import NotTaught
from handeye.server.answering import NothingTaught
from handeye.server.demonstration import Demonstration, Subtask
from handeye.server.livemodules import LiveModules
from handeye.server.pairs import NotTeachable, pairs, waypoint_codes
from handeye.server.problem import Conflict, NotFound, sentence
from handeye.server.results import SubtaskStatistics, TrainStatistics
from handeye.server.skill import SkillAnswer
from handeye.server.store import Store
from handeye.server.store import modules as stored_modules
from handeye.server.store import tasks as stored_tasks
from handeye.server.store.rows import loads

Method = Literal["local_quadratic", "local_linear", "kndb", "kndb2", "nearest"]


class TrainRequest(BaseModel):
    """How to train: from which pairs, and how answers are made."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    pairs: Literal["all", "key"] = "all"
    """`key`: only the thesis's bare pairs, one from the beginning of each subtask."""
    approximator: Method | ApproximatorSettings | None = None
    """The method by name, or with its settings; null: module IJS's own."""
    frame: Frame | None = None
    """In which axes the way from hand to object is told; null: in the hand's own, if module CSS was taught and the hand
    was always seen with its outline, else in the picture's."""


def common_subtasks(demonstrations: Sequence[Demonstration]) -> tuple[Subtask, ...]:
    """The subtasks in order; `NotTeachable` when the demonstrations disagree about them.

    How long each piece of a way takes is the median of what was shown.
    """
    first = demonstrations[0]
    for other in demonstrations[1:]:
        if _untimed(other.subtasks) != _untimed(first.subtasks):
            raise NotTeachable(
                f"Demonstrations '{first.id}' and '{other.id}' disagree about subtasks, their objects, their ways or "
                f"gripper actions: {_spelled(first)} against {_spelled(other)}."
            )
    shown = zip(*(each.subtasks for each in demonstrations), strict=True)
    return tuple(replace(same[0], way=tuple(np.median([each.way for each in same], axis=0).tolist())) for same in shown)


@dataclass(frozen=True, slots=True)
class TrainedTask:
    """A task that was taught: its subtasks in order, and the module IJS that answers in each of them."""

    name: str
    module_name: str
    subtasks: tuple[Subtask, ...]
    demonstrations: tuple[str, ...]
    """The ids of those that it was trained from and still answers by."""
    frame: Frame
    tasks: Tasks = field(repr=False, compare=False)

    def answer(self, subtask: str, found: ImagePair, joints: Joints, waypoint: int | None = None) -> SkillAnswer:
        """ASM and IJS: how far each joint is to turn towards the goal of `subtask`, and where that comes from.

        With `waypoint`, a number, towards that of the subtask's way-points.

        The module answers as it is now. `NotFound` when the task was deleted meanwhile, `Conflict` when it was trained
        anew with other subtasks or axes, `NothingTaught` when what it was taught in this subtask was taken out.
        """
        module = self.tasks.module(self)  # before it is compared: what is trained anew is in the store first
        frame, subtasks = self.tasks.declared(self.name)
        if (frame, _untimed(subtasks)) != (self.frame, _untimed(self.subtasks)):
            raise Conflict(
                f"Task '{self.name}' was trained anew with other subtasks or axes while it ran; run it again."
            )
        number = [each.name for each in self.subtasks].index(subtask)
        if waypoint is not None:
            number = waypoint_codes(self.subtasks)[subtask][waypoint]
        try:
            action = pipeline.specify_action(found, self.tasks.css() if self.frame == "hand" else None)
            turn, answer = pipeline.image_to_joints(module, number, action, JointAngles(joints))
        except NotTaught as error:
            raise NothingTaught(sentence(error)) from error
        return SkillAnswer(turn, answer, action.support if isinstance(action, HandVector) else 1.0)


class Tasks:
    """The trained tasks by name: which they are is in the store, how they answer in modules. Safe among threads."""

    def __init__(self, store: Store, modules: LiveModules) -> None:
        self._store = store
        self._modules = modules

    def train(self, name: str, shown: Sequence[Demonstration], request: TrainRequest) -> TrainStatistics:
        """Trains task `name` from finished demonstrations; an earlier training of it is replaced.

        `NotFound` without demonstrations; `NotTeachable` when they do not make a task.
        """
        if not shown:
            raise NotFound(f"There is no finished demonstration of task '{name}'; show it by POST /v1/demonstrations.")
        subtasks = common_subtasks(shown)
        frame = request.frame or self._frame_for(shown)
        css = self._css_for(shown) if frame == "hand" else None
        taught = pairs(shown, subtasks, css, key_only=request.pairs == "key")
        module_name = f"IJS.{name}"
        declaration = declare(frame, request.approximator).model_copy(update={"name": module_name})
        content = {
            "frame": frame,
            "subtasks": [asdict(subtask) for subtask in subtasks],
            "demonstrations": [demonstration.id for demonstration in shown],
        }
        with self._store.write() as connection:
            if name not in stored_tasks.of_module(connection, module_name):
                self._require_unused(module_name, name)
            module = self._modules.replace(declaration, taught.inputs, taught.outputs, taught.demonstrations)
            stored_tasks.write(connection, name, module_name, content)
        return TrainStatistics(
            task=name,
            module=module_name,
            demonstrations=tuple(demonstration.id for demonstration in shown),
            pairs=module.samples,
            subtasks=_subtask_statistics(subtasks, module.statistics()),
            approximator=declaration.approximator,
            frame=frame,
        )

    def get(self, name: str) -> TrainedTask:
        """The trained task of that name; `NotFound` when there is none."""
        with self._store.read() as connection:
            return self._trained(connection, _row(connection, name))

    def declared(self, name: str) -> tuple[Frame, tuple[Subtask, ...]]:
        """The axes of that task and its subtasks, for each look anew; `NotFound` when there is no such task."""
        with self._store.read() as connection:
            return _declared(loads(_row(connection, name)["content"]))

    def all(self) -> tuple[TrainedTask, ...]:
        """By name."""
        with self._store.read() as connection:
            return tuple(self._trained(connection, dict(row)) for row in stored_tasks.all_tasks(connection))

    def module(self, task: TrainedTask) -> Module:
        """The module that answers for a task; `NotReady` while it is being built."""
        return self._modules.live(task.module_name)

    def delete(self, name: str) -> None:
        """Forgets a trained task and its module; its demonstrations stay. `NotFound` when there is none."""
        with self._store.write() as connection:
            task = self.get(name)
            stored_tasks.drop(connection, name)
            self._modules.delete(task.module_name)

    def _trained(self, connection: Connection, row: Mapping[str, Any]) -> TrainedTask:
        content = loads(row["content"])
        frame, subtasks = _declared(content)
        left = stored_modules.demonstrations_of(connection, row["module"])
        shown = tuple(name for name in content["demonstrations"] if name in left)
        return TrainedTask(row["name"], row["module"], subtasks, shown, frame, self)

    def css(self) -> Module:
        """Module CSS; `NothingTaught` when it is not there."""
        try:
            return self._modules.live(CSS.name)
        except NotFound as error:
            raise NothingTaught(
                "The way from hand to object is told in the hand's own axes, which takes module CSS; let it be taught "
                "by `handeye collect CSS`, or train the task in the picture's axes."
            ) from error

    def _frame_for(self, shown: Sequence[Demonstration]) -> Frame:
        try:
            taught = bool(self.css().samples)
        except NothingTaught:
            return "picture"
        return "hand" if taught and _outlined(shown) else "picture"

    def _css_for(self, shown: Sequence[Demonstration]) -> Module:
        if not _outlined(shown):
            raise NotTeachable(
                "In some of the demonstrations the hand was seen as a point only: show them again, or train the task "
                "in the picture's axes."
            )
        return self.css()

    def _require_unused(self, module: str, task: str) -> None:
        if any(each.name == module for each in self._modules.all()):
            raise Conflict(
                f"Task '{task}' answers by a module '{module}', and there is one of that name that belongs to no task; "
                f"delete it by DELETE /v1/modules/{module}."
            )


def _row(connection: Connection, name: str) -> Mapping[str, Any]:
    row = stored_tasks.read(connection, name)
    if row is not None:
        return row
    known = ", ".join(repr(each["name"]) for each in stored_tasks.all_tasks(connection)) or "none yet"
    raise NotFound(f"Task '{name}' is not trained (trained: {known}); train it by POST /v1/tasks/{name}/train.")


def _declared(content: Mapping[str, Any]) -> tuple[Frame, tuple[Subtask, ...]]:
    subtasks = tuple(
        Subtask(each["name"], each["action"], each.get("object"), tuple(each.get("way", ())))
        for each in content["subtasks"]
    )
    return content.get("frame", "picture"), subtasks


def declare(frame: Frame, approximator: Method | ApproximatorSettings | None) -> ModuleDeclaration:
    """Module IJS with this approximator; a method by name comes with the settings that suit IJS."""
    declaration = ijs.IN_HAND if frame == "hand" else ijs.DECLARATION
    if approximator is None:
        return declaration
    if isinstance(approximator, str):
        approximator = ijs.APPROXIMATORS[approximator]
    return declaration.model_copy(update={"approximator": approximator})


def _outlined(shown: Sequence[Demonstration]) -> bool:
    """Whether the hand was seen with its outline in every look."""
    looks = [look.found for each in shown for look in each.observations if look.found is not None]
    return all(isinstance(found.hand, HandPoint) for found in looks)


def _subtask_statistics(
    subtasks: Sequence[Subtask], learned: Sequence[CategoryStatistics]
) -> tuple[SubtaskStatistics, ...]:
    """Of the pairs towards goals; those towards way-points are as many for each of them."""
    trees = {int(each.category[0]): each for each in learned}
    return tuple(
        SubtaskStatistics(
            name=subtask.name,
            action=subtask.action,
            pairs=trees[number].samples,
            nodes=trees[number].tree.nodes,
            levels=trees[number].tree.levels,
        )
        for number, subtask in enumerate(subtasks)
    )


def _untimed(subtasks: Sequence[Subtask]) -> list[Subtask]:
    """Subtasks without how long their ways take, which nobody shows twice alike."""
    return [replace(subtask, way=(0.0,) * len(subtask.way)) for subtask in subtasks]


def _spelled(demonstration: Demonstration) -> str:
    def spelled(subtask: Subtask) -> str:
        towards = f" towards {subtask.object}" if subtask.object else ""
        way = f" along {len(subtask.way)} way-points" if subtask.way else ""
        return subtask.name + towards + way + (f" ({subtask.action})" if subtask.action else "")

    return ", ".join(map(spelled, demonstration.subtasks))
