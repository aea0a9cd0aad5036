"""What jobs leave behind (their JSON): of a run every look, answer, neighbour and move, of a training what it made."""

from __future__ import annotations

from datetime import datetime
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, WithJsonSchema

from handeye.modules.answers import Answer
from handeye.modules.asm import Frame
from handeye.modules.declaration import ApproximatorSettings

THREE = WithJsonSchema({"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3})
"""How three numbers are described: many a generator of clients does not know a schema for each place of an array."""

Triple = Annotated[tuple[float, float, float], THREE]


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class NeighbourRecord(_Record):
    """A taught sample that an answer came from."""

    sample: int
    """Its number in the module."""
    demonstration: str | None
    distance: float
    """From the query, in the module's scaled input units."""
    weight: float
    """Its share in the answer."""

    @classmethod
    def nearest_of(cls, answer: Answer, most: int) -> tuple[NeighbourRecord, ...]:
        """At most so many of an answer's neighbours, the nearest first."""
        return tuple(
            cls(sample=n.sample_id, demonstration=n.demonstration, distance=n.distance, weight=n.weight)
            for n in answer.neighbours[:most]
        )


class LookRecord(_Record):
    """One look: what was seen, what was answered, what was moved."""

    number: int
    """Counts the looks of the run, from 0."""
    world_time: float
    """World time that the left picture shows, in s."""
    object: Triple
    """(row, column, disparity) of the object, in pixels."""
    hand: Triple
    """(row, column, disparity) of the hand, in pixels."""
    hand_seen: bool = True
    """False: something hid the hand, and it was taken to be where the joints have it."""
    object_confidence: float | None = None
    """How surely this is the object, in [0, 1]; null in runs of before it was written down."""
    hand_confidence: float | None = None
    """The same of the hand."""
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


class WaypointRecord(_Record):
    """A way-point that a run has passed without looking."""

    delta: tuple[float, ...]
    """The answer: joint differences in rad, base to wrist, from where the arm was at the last look."""
    seconds: float
    """World time that the way there was to take, in s."""
    support: float
    """1: amid what was taught; towards 0: outside of it."""
    neighbours: tuple[NeighbourRecord, ...]
    """The nearest ones, nearest first; the weights of all add up to 1."""
    moved: tuple[float, ...]
    """Joint differences in rad that the robot reports to have made, from the way-point before."""


class SubtaskRecord(_Record):
    """One subtask of a run."""

    name: str
    object: str | None = None
    """What it is towards; null in runs of earlier versions."""
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
    way: tuple[WaypointRecord, ...] = ()
    """The way-points that it has passed after the last look."""


class RunResult(_Record):
    """A run so far."""

    subtasks: tuple[SubtaskRecord, ...]


class SubtaskStatistics(_Record):
    """A trained subtask: what the gripper does at its end, its pairs, and the tree that holds them."""

    name: str
    action: str | None
    pairs: int
    nodes: int
    levels: int


class TrainStatistics(_Record):
    """What a task was trained from, and the module that answers for it."""

    task: str
    module: str
    demonstrations: tuple[str, ...]
    pairs: int
    subtasks: tuple[SubtaskStatistics, ...]
    approximator: ApproximatorSettings
    frame: Frame
    """In which axes the way from hand to object is told."""


class CategoryInfo(_Record):
    """What a module learned for one combination of categories."""

    category: tuple[float, ...]
    """Values of the categorical components; empty where there are none."""
    samples: int
    demonstrations: int
    nodes: int
    levels: int
    median_reach: float
    """Half of the samples lie closer than this to a sample of another demonstration, in scaled units."""
    largest_reach: float
    """All of them do: support is 1/2 at this distance from the nearest sample."""


class ModuleStatistics(_Record):
    """What a module learned."""

    module: str
    samples: int
    categories: tuple[CategoryInfo, ...]


class RobotInfo(_Record):
    """What the robot's own sensors say."""

    world_time: float
    """In s."""
    joints: tuple[float, ...]
    """In rad, base to wrist."""
    velocities: tuple[float, ...]
    """In rad/s."""
    point: Triple
    """The tool centre point that the robot's own kinematics make of its joints, (x, y, z) in m, world frame."""
    gripper_opening: float
    """Between the pads, in m."""
    moving: bool
    stopped: bool
    """The software stop is latched; moves are refused until a reset."""
    still_since: float | None
    """World time since when arm and gripper stand still, in s; null while they move."""
    lease_holder: str
    """Who controls the robot; empty when nobody does."""


class HeadInfo(_Record):
    """Where the head points."""

    pan: float
    """In rad; positive to its left."""
    tilt: float
    """In rad; positive upwards."""
    moving: bool
    world_time: float
    """In s."""


class AnswerRecord(_Record):
    """What one module's answer came from."""

    module: str
    support: float
    """1: amid what was taught; towards 0: outside of it."""
    neighbours: tuple[NeighbourRecord, ...]
    """The nearest ones, nearest first."""


class ReachLook(_Record):
    """One look of a reach: where the hand was seen, how far from its goal, and what was moved for it."""

    number: int
    """Counts the looks, from 0."""
    world_time: float
    """World time that the left picture shows, in s."""
    target: Triple
    """(row, column, disparity) of where the hand is to be, in pixels."""
    hand: Triple
    """The same of where it is seen."""
    away: float
    """How far these two are apart by what was learned, in m."""
    delta: tuple[float, ...]
    """The answer: joint differences in rad, base to wrist; empty when no motion was asked for."""
    moved: tuple[float, ...]
    """Joint differences in rad that the robot reports to have made; empty when nothing was moved."""
    answers: tuple[AnswerRecord, ...]
    """Of CSS and CAS for the target, of CSS and CAS for the hand, and of AJS."""
    picture: str
    """Path of the look's picture; only the newest few jobs keep theirs."""


class ReachResult(_Record):
    """A reach so far."""

    looks: tuple[ReachLook, ...]


class GazeLook(_Record):
    """One look of a gaze: where the thing was seen, and how the head was turned for it."""

    number: int
    """Counts the looks, from 0."""
    world_time: float
    """World time that the left picture shows, in s."""
    point: Triple
    """(row, column, disparity) in pixels."""
    offset: float
    """From the middle of the left picture, in px."""
    pan: float
    """Where the head pointed, in rad."""
    tilt: float
    """In rad."""
    turn: tuple[float, ...]
    """How far the head was to turn, (pan, tilt) in rad; empty when it was not turned."""
    support: float
    """Of the answer; 1 when none was asked for."""


class GazeResult(_Record):
    """A gaze so far."""

    looks: tuple[GazeLook, ...]
    middle: tuple[float, ...]
    """(row, column) of the middle of the left picture, in px."""


class PursuitLook(_Record):
    """One look of a pursuit: where the object was seen, and what course the head took for it."""

    number: int
    """Counts the looks, from 0."""
    world_time: float
    """World time that the left picture shows, in s."""
    pan: float
    """Where the head pointed then, in rad."""
    tilt: float
    """In rad."""
    point: Triple | None = None
    """(row, column, disparity) in pixels; null when the object was not seen."""
    offset: float | None = None
    """From the middle of the left picture, in px."""
    turn: tuple[float, ...] = ()
    """How far from there the object was, (pan, tilt) in rad, by SCS."""
    support: float | None = None
    """Of that answer."""
    rate: tuple[float, ...] = ()
    """How fast the object was held to move, (pan, tilt) in rad/s; empty when the head was not sent after it."""
    late: float | None = None
    """World time from the picture's exposure until the head was told its course, in s."""


class PursuitResult(_Record):
    """A pursuit so far."""

    duration: float
    """How long it is to last, in s of world time."""
    looks: tuple[PursuitLook, ...]
    middle: tuple[float, ...]
    """(row, column) of the middle of the left picture, in px."""


class CollectResult(_Record):
    """What was collected so far."""

    added: dict[str, int]
    """Samples by module."""
    rejected: dict[str, int]
    """What was not written down, by reason."""


class JobState(StrEnum):
    """Where a job stands."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"
    INTERRUPTED = "interrupted"
    """The coordinator ended before the job did."""


class JobError(_Record):
    """Why a job failed or was cancelled: a stable code and a sentence."""

    code: str
    message: str


class JobView(_Record):
    """A job as the REST interface shows it."""

    id: str
    kind: Literal["run", "train", "motion", "reach", "gaze", "pursuit", "collect"]
    subject: str
    """The task that is run, the task or module that is trained, the motion, what is reached for, looked at or followed,
    or what is collected for."""
    object: str | None
    """What a task is done with."""
    state: JobState
    progress: float | None
    """Share done, 0..1; null when it is not known."""
    error: JobError | None
    result: (
        RunResult
        | TrainStatistics
        | ModuleStatistics
        | RobotInfo
        | HeadInfo
        | ReachResult
        | GazeResult
        | PursuitResult
        | CollectResult
        | None
    )
    """So far; of a run `subtasks`, of a training statistics, of a motion the state that was reached, of a reach, a
    gaze or a pursuit its looks, of collecting what was added."""
    created: datetime
    started: datetime | None
    ended: datetime | None
