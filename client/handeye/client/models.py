"""What the coordinator answers, as the client reads it. Keys that this version does not know are ignored."""

from __future__ import annotations

from datetime import datetime
from typing import Literal

from handeye.client._job_models import (
    AnswerOf,
    CollectJob,
    CollectResult,
    GazeJob,
    GazeLook,
    GazeResult,
    Job,
    JobError,
    JobEvent,
    Look,
    MotionJob,
    Neighbour,
    OnEvent,
    Point,
    PursuitJob,
    PursuitLook,
    PursuitResult,
    ReachJob,
    ReachLook,
    ReachResult,
    RunJob,
    RunResult,
    Seen,
    SubtaskResult,
    SubtaskStatistics,
    TrainJob,
    TrainStatistics,
)
from handeye.client._model import Model, PageModel
from handeye.client._module_models import (
    CategoryStatistics,
    Component,
    Declaration,
    ModuleInfo,
    ModuleStatistics,
    Output,
    Sample,
    Snapshot,
    Tree,
    TreeNode,
)
from handeye.client._robot_models import Head, HeadDescription, Robot, RobotDescription

__all__ = [
    "AnswerOf",
    "CategoryStatistics",
    "CollectJob",
    "CollectResult",
    "Component",
    "Declaration",
    "Demonstration",
    "GazeJob",
    "GazeLook",
    "GazeResult",
    "Head",
    "HeadDescription",
    "Job",
    "JobError",
    "JobEvent",
    "Look",
    "ModuleInfo",
    "ModuleStatistics",
    "MotionJob",
    "Neighbour",
    "NewToken",
    "Observation",
    "OnEvent",
    "Outcome",
    "Output",
    "Point",
    "PursuitJob",
    "PursuitLook",
    "PursuitResult",
    "ReachJob",
    "ReachLook",
    "ReachResult",
    "Recording",
    "Restored",
    "Robot",
    "RobotDescription",
    "Role",
    "RunJob",
    "RunResult",
    "Sample",
    "Seen",
    "Snapshot",
    "Subtask",
    "SubtaskResult",
    "SubtaskStatistics",
    "Task",
    "TaughtObject",
    "Token",
    "TrainJob",
    "TrainStatistics",
    "Tree",
    "TreeNode",
]

Outcome = Literal["success", "failure"]
Role = Literal["viewer", "operator", "admin"]


class TaughtObject(Model):
    """An object: stereo pairs without (`backgrounds`) and with it (`examples`); `learned`: it can be recognised."""

    name: str
    backgrounds: int
    examples: int
    learned: bool


class TaughtObjects(Model):
    """The objects, in the order of their first pictures."""

    objects: tuple[TaughtObject, ...]


class Subtask(Model):
    """A part of a task; `action` is what the gripper does at its end.

    `object`: what it is towards, None for the object that the task is done with; `way`: seconds to each way-point.
    """

    name: str
    action: Literal["close_gripper", "open_gripper"] | None
    object: str | None = None
    way: tuple[float, ...] = ()


class Demonstration(Model):
    """A demonstration so far; `observations` counts them. Of an `outcome` "failure" nothing is learned."""

    id: str
    task: str
    object: str
    state: Literal["recording", "finished"]
    observations: int
    subtasks: tuple[Subtask, ...]
    outcome: Outcome | None
    created: datetime


class Observation(Model):
    """What was recognised and read: joints in rad, world time in s. At a way-point nobody looks: no object, no hand."""

    number: int
    subtask: str
    towards: str
    goal: bool
    key: bool
    world_time: float
    object: Point | None
    hand: Point | None
    joints: tuple[float, ...]
    seconds: float


class Demonstrations(PageModel):
    """Demonstrations, in the order they were begun."""

    demonstrations: tuple[Demonstration, ...]


class Recording(Model):
    """All that was observed in a demonstration, in order."""

    observations: tuple[Observation, ...]


class Task(Model):
    """A trained task: the module that answers for it, its subtasks in order, the demonstrations it was taught by."""

    name: str
    module: str
    subtasks: tuple[Subtask, ...]
    demonstrations: tuple[str, ...]


class Tasks(Model):
    """The trained tasks, by name."""

    tasks: tuple[Task, ...]


class Restored(Model):
    """What is there after a backup was restored."""

    modules: int
    samples: int


class Token(Model):
    """A token as it is known after it was made; `expires`: None when it does not."""

    id: str
    name: str
    role: Role
    created: datetime
    expires: datetime | None


class NewToken(Token):
    """A token just made; `token` is the secret itself, which nobody can read again."""

    token: str


class Tokens(Model):
    """The tokens, oldest first."""

    tokens: tuple[Token, ...]
