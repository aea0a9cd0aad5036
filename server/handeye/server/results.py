"""What a run leaves behind: every look, answer, neighbour and move it made (the JSON of a job)."""

from __future__ import annotations

from enum import StrEnum
from typing import Literal

from pydantic import BaseModel, ConfigDict


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class NeighbourRecord(_Record):
    """A taught sample that an answer came from."""

    demonstration: str
    distance: float
    """From the query, in the module's scaled input units."""
    weight: float
    """Its share in the answer."""


class LookRecord(_Record):
    """One look: what was seen, what was answered, what was moved."""

    number: int
    """Counts the looks of the run, from 0."""
    world_time: float
    """World time that the left picture shows, in s."""
    object: tuple[float, float, float]
    """(row, column, disparity) of the object, in pixels."""
    hand: tuple[float, float, float]
    """(row, column, disparity) of the hand, in pixels."""
    delta: tuple[float, ...]
    """The answer: joint differences in rad, base to wrist."""
    support: float
    """1: amid what was taught; towards 0: outside of it."""
    neighbours: tuple[NeighbourRecord, ...]
    """The nearest ones, nearest first; the weights of all add up to 1."""
    moved: tuple[float, ...]
    """Joint differences in rad that the robot reports to have made; empty when nothing was moved."""
    picture: str
    """Path of the look's picture; only the newest few runs keep theirs."""


class SubtaskRecord(_Record):
    """One subtask of a run."""

    name: str
    state: Literal["running", "succeeded", "failed"]
    started: float
    """World time in s."""
    ended: float | None = None
    """World time in s."""
    aligned: bool = False
    """The last answer was within the tolerance; False when the looks ran out first (or there was one look only)."""
    action: str | None = None
    """What the gripper did at the end."""
    looks: tuple[LookRecord, ...] = ()


class RunResult(_Record):
    """A run so far."""

    subtasks: tuple[SubtaskRecord, ...]


class JobState(StrEnum):
    """Where a job stands."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"


class JobError(_Record):
    """Why a job failed or was cancelled: a stable code and a sentence."""

    code: str
    message: str


class JobView(_Record):
    """A job as the REST interface shows it."""

    id: str
    task: str
    object: str
    state: JobState
    error: JobError | None
    result: RunResult
