"""Jobs, and what they leave behind."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from typing import Any, ClassVar, Literal, Self

from pydantic import Field, ModelWrapValidatorHandler, field_validator, model_validator

from handeye.client._model import Model, PageModel
from handeye.client._module_models import ModuleStatistics
from handeye.client._robot_models import Head, Robot
from handeye.client.errors import JobFailed

Point = tuple[float, float, float]
"""(row, column, disparity) in pixels."""


class SubtaskStatistics(Model):
    """A trained subtask: its gripper action, its training pairs, and the tree that holds them."""

    name: str
    action: str | None
    pairs: int
    nodes: int
    levels: int


class TrainStatistics(Model):
    """What a task was trained from, and the module that answers for it; `approximator` says how.

    `frame`: in which axes the way from hand to object is told.
    """

    task: str
    module: str
    demonstrations: tuple[str, ...]
    pairs: int
    subtasks: tuple[SubtaskStatistics, ...]
    approximator: dict[str, Any]
    frame: Literal["picture", "hand"]


class Neighbour(Model):
    """A taught sample that an answer came from, its distance to the query and its share in the answer."""

    sample: int
    demonstration: str | None
    distance: float
    weight: float


class Look(Model):
    """One look: world time in s; answer `delta` and reported `moved` in rad; `picture` is for `Client.picture`.

    `hand_seen` is False when something hid the hand, and it was taken to be where the joints have it. Confidences are
    in [0, 1]; None in runs of before they were written down.
    """

    number: int
    world_time: float
    object: Point
    hand: Point
    hand_seen: bool
    object_confidence: float | None = None
    hand_confidence: float | None = None
    delta: tuple[float, ...]
    support: float
    neighbours: tuple[Neighbour, ...]
    moved: tuple[float, ...]
    picture: str


class Waypoint(Model):
    """A way-point that a run has passed without looking; `delta` from where the last look was, in rad."""

    delta: tuple[float, ...]
    seconds: float
    support: float
    neighbours: tuple[Neighbour, ...]
    moved: tuple[float, ...]


class SubtaskResult(Model):
    """One subtask of a run; `started` and `ended` are world times in s; `aligned`: within the tolerance at its end."""

    name: str
    object: str | None = None
    state: Literal["running", "succeeded", "failed"]
    started: float
    ended: float | None
    aligned: bool
    action: str | None
    looks: tuple[Look, ...]
    way: tuple[Waypoint, ...] = ()


class RunResult(Model):
    """The subtasks that a run has begun."""

    subtasks: tuple[SubtaskResult, ...]


class Seen(Model):
    """Where something was seen, `point` in px, and how surely, in [0, 1]; head in rad; world time in s."""

    point: Point
    confidence: float
    pan: float
    tilt: float
    world_time: float


class AnswerOf(Model):
    """What one module's answer came from."""

    module: str
    support: float
    neighbours: tuple[Neighbour, ...]


class ReachLook(Model):
    """One look of a reach: hand and target in px, `away` from each other in m; `delta` and `moved` in rad."""

    number: int
    world_time: float
    target: Point
    hand: Point
    away: float
    delta: tuple[float, ...]
    moved: tuple[float, ...]
    answers: tuple[AnswerOf, ...]
    picture: str


class ReachResult(Model):
    """The looks of a reach."""

    looks: tuple[ReachLook, ...]


class GazeLook(Model):
    """One look of a gaze: `point` and its `offset` from the middle in px; the head and its `turn` in rad."""

    number: int
    world_time: float
    point: Point
    offset: float
    pan: float
    tilt: float
    turn: tuple[float, ...]
    support: float


class GazeResult(Model):
    """The looks of a gaze; `middle` of the left picture (row, column) in px."""

    looks: tuple[GazeLook, ...]
    middle: tuple[float, float]


class PursuitLook(Model):
    """One look of a pursuit: `point` and its `offset` in px, None when it was not seen; the head and its `turn` in rad.

    `rate` is (pan, tilt) in rad/s; `late` the time from the exposure until the head was told its course, in s.
    """

    number: int
    world_time: float
    pan: float
    tilt: float
    point: Point | None
    offset: float | None
    turn: tuple[float, ...]
    support: float | None
    rate: tuple[float, ...]
    late: float | None


class PursuitResult(Model):
    """The looks of a pursuit that is to last `duration` s; `middle` of the left picture (row, column) in px."""

    duration: float
    looks: tuple[PursuitLook, ...]
    middle: tuple[float, float]


class CollectResult(Model):
    """Samples that were added, by module, and what was not written down, by reason."""

    added: dict[str, int]
    rejected: dict[str, int]


class JobError(Model):
    """Why a job failed: a stable code and a sentence."""

    code: str
    message: str


class Job(Model):
    """Long work: a run of a task, a training, a motion, a reach, a gaze, a pursuit, collecting.

    It is read as the class of its kind. `subject` is the task, module, action or thing; `progress` is a share in
    [0, 1], None while it is not known.
    """

    id: str
    kind: str
    subject: str
    object: str | None = None
    state: Literal["queued", "running", "succeeded", "failed", "cancelled", "interrupted"]
    progress: float | None = None
    error: JobError | None = None
    result: Any = None
    created_at: datetime | None = Field(default=None, validation_alias="created")
    started_at: datetime | None = Field(default=None, validation_alias="started")
    ended_at: datetime | None = Field(default=None, validation_alias="ended")

    noun: ClassVar[str] = "Job"

    @model_validator(mode="wrap")
    @classmethod
    def _as_its_kind(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Job:
        if cls is Job and isinstance(data, dict) and (kind := _KINDS.get(data.get("kind", ""))) is not None:
            return kind.model_validate(data)
        return handler(data)

    @property
    def ended(self) -> bool:
        """Nothing more will happen in it."""
        return self.state in ("succeeded", "failed", "cancelled", "interrupted")

    @property
    def succeeded(self) -> bool:
        """All of it was done."""
        return self.state == "succeeded"

    @property
    def failure(self) -> str:
        """A sentence about why the job did not succeed."""
        reason = self.error.message if self.error else "it has not ended"
        return f"{self.noun} '{self.subject}' {self._how_it_ended()}: {reason}"

    def raise_for_failure(self) -> Self:
        """The job itself when it succeeded; raises `JobFailed` when not."""
        if not self.succeeded:
            raise JobFailed(self)
        return self

    def _how_it_ended(self) -> str:
        return self.state if self.state in ("succeeded", "failed") else f"was {self.state}"


class RunJob(Job):
    """A run of the task `subject` with `object`."""

    kind: Literal["run"]
    object: str
    result: RunResult = RunResult(subtasks=())

    noun = "Task"

    @field_validator("result", mode="before")
    @classmethod
    def _nothing_yet(cls, value: Any) -> Any:
        return {"subtasks": ()} if value is None else value

    def _how_it_ended(self) -> str:
        where = next((f" in subtask '{s.name}'" for s in reversed(self.result.subtasks) if s.state == "failed"), "")
        return super()._how_it_ended() + where


class TrainJob(Job):
    """Training of the task or module `subject`; `result` are its statistics."""

    kind: Literal["train"]
    result: TrainStatistics | ModuleStatistics | None = None

    noun = "Training"


class MotionJob(Job):
    """A motion of the arm (`subject` is the action) or of the head; `result` is what was reached."""

    kind: Literal["motion"]
    result: Robot | Head | None = None

    noun = "Motion"


class ReachJob(Job):
    """A reach of the hand for `subject`."""

    kind: Literal["reach"]
    result: ReachResult | None = None

    noun = "Reach for"


class GazeJob(Job):
    """A turn of the head to `subject`."""

    kind: Literal["gaze"]
    result: GazeResult | None = None

    noun = "Gaze at"


class PursuitJob(Job):
    """A pursuit of `subject` by the head."""

    kind: Literal["pursuit"]
    result: PursuitResult | None = None

    noun = "Pursuit of"


class CollectJob(Job):
    """Collecting of samples for the modules `subject`."""

    kind: Literal["collect"]
    result: CollectResult | None = None

    noun = "Collecting for"


_KINDS: dict[str, type[Job]] = {
    "run": RunJob,
    "train": TrainJob,
    "motion": MotionJob,
    "reach": ReachJob,
    "gaze": GazeJob,
    "pursuit": PursuitJob,
    "collect": CollectJob,
}


class Jobs(PageModel):
    """Jobs, the newest first."""

    jobs: tuple[Job, ...]


class JobEvent(Model):
    """Something that happened in a job; `number` counts from 1.

    `kind` is state (data: the job), progress, subtask, look, waypoint, not_seen, stop or posture.
    """

    number: int
    kind: str
    data: dict[str, Any]


OnEvent = Callable[[JobEvent], None]
"""What is told a job's events, in the thread or task that waits for the job."""
