"""What the coordinator answers, as the client reads it. Keys that this version does not know are ignored."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from handeye.client.errors import JobFailed

Point = tuple[float, float, float]
"""(row, column, disparity) in pixels."""


class _Model(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class TaughtObject(_Model):
    """An object: stereo pairs without (`backgrounds`) and with it (`examples`); `learned`: it can be recognised."""

    name: str
    backgrounds: int
    examples: int
    learned: bool


class TaughtObjects(_Model):
    """The objects, in the order of their first pictures."""

    objects: tuple[TaughtObject, ...]


class Subtask(_Model):
    """A part of a task; `action` is what the gripper does at its end."""

    name: str
    action: str | None


class Demonstration(_Model):
    """A demonstration so far; `observations` counts them."""

    id: str
    task: str
    object: str
    state: Literal["recording", "finished"]
    observations: int
    subtasks: tuple[Subtask, ...]


class Demonstrations(_Model):
    """The demonstrations, in the order they were begun."""

    demonstrations: tuple[Demonstration, ...]


class Observation(_Model):
    """What was recognised and read: joints in rad, world time in s."""

    number: int
    subtask: str
    goal: bool
    key: bool
    world_time: float
    object: Point
    hand: Point
    joints: tuple[float, ...]


class SubtaskStatistics(_Model):
    """A trained subtask: its gripper action, its training pairs, and the tree that holds them."""

    name: str
    action: str | None
    pairs: int
    nodes: int
    levels: int


class TrainStatistics(_Model):
    """What a task was trained from; `approximator` says how answers are made."""

    task: str
    demonstrations: tuple[str, ...]
    pairs: int
    subtasks: tuple[SubtaskStatistics, ...]
    approximator: dict[str, Any]


class Neighbour(_Model):
    """A taught sample that an answer came from, its distance to the query and its share in the answer."""

    demonstration: str
    distance: float
    weight: float


class Look(_Model):
    """One look: world time in s; answer `delta` and reported `moved` in rad; `picture` is for `Client.picture`."""

    number: int
    world_time: float
    object: Point
    hand: Point
    delta: tuple[float, ...]
    support: float
    neighbours: tuple[Neighbour, ...]
    moved: tuple[float, ...]
    picture: str


class SubtaskResult(_Model):
    """One subtask of a run; `started` and `ended` are world times in s; `aligned`: within the tolerance at its end."""

    name: str
    state: Literal["running", "succeeded", "failed"]
    started: float
    ended: float | None
    aligned: bool
    action: str | None
    looks: tuple[Look, ...]


class RunResult(_Model):
    """The subtasks that a run has begun."""

    subtasks: tuple[SubtaskResult, ...]


class JobError(_Model):
    """Why a job failed: a stable code and a sentence."""

    code: str
    message: str


class Job(_Model):
    """A run of a task."""

    id: str
    task: str
    object: str
    state: Literal["queued", "running", "succeeded", "failed", "cancelled"]
    error: JobError | None
    result: RunResult

    @property
    def ended(self) -> bool:
        """Nothing more will happen in it."""
        return self.state in ("succeeded", "failed", "cancelled")

    @property
    def succeeded(self) -> bool:
        """Every subtask was done."""
        return self.state == "succeeded"

    @property
    def failure(self) -> str:
        """A sentence about why the job did not succeed."""
        reason = self.error.message if self.error else "it has not ended"
        where = next((f" in subtask '{s.name}'" for s in self.result.subtasks if s.state == "failed"), "")
        return f"Task '{self.task}' {self.state}{where}: {reason}"

    def raise_for_failure(self) -> Job:
        """The job itself when it succeeded; raises `JobFailed` when not."""
        if not self.succeeded:
            raise JobFailed(self)
        return self


class JobEvent(_Model):
    """Something that happened in a job: `kind` is state, subtask, look, not_seen or stop; `number` counts from 1."""

    number: int
    kind: str
    data: dict[str, Any]


class Robot(_Model):
    """What the robot's own sensors say: s, rad, rad/s, m; `still_since` is None while it moves."""

    world_time: float
    joints: tuple[float, ...]
    velocities: tuple[float, ...]
    gripper_opening: float
    moving: bool
    stopped: bool
    still_since: float | None
    lease_holder: str
