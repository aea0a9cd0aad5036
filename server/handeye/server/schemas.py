"""The bodies of requests and answers of the REST interface. Unknown keys are refused."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, FailFast, Field, FiniteFloat, Strict, StrictBool

from handeye.modules.declaration import MOST_COMPONENTS, ApproximatorSettings, ModuleDeclaration
from handeye.server.demonstration import Action, Outcome
from handeye.server.results import THREE, HeadInfo, JobView, Triple

# Ranges, because what \w means differs between JSON Schema, Python and pydantic.
_LETTERS = r"0-9A-Z_a-z\u00c0-\u1fff\u2c00-\u2fef\u3001-\ud7ff\uf900-\ufdcf\ufdf0-\uffef"

Name = Annotated[str, Field(pattern=rf"^[{_LETTERS}][{_LETTERS} .-]{{0,62}}$", examples=["blue cup"])]
"""A name of an object, task or subtask: letters, digits, '_', '.', '-', and spaces; at most 63 characters."""

LONG_NAME = rf"^[{_LETTERS}][{_LETTERS} .-]{{0,78}}$"

ModuleName = Annotated[str, Field(pattern=LONG_NAME, examples=["CSS"])]
"""The same for a module, which may be longer: a task's is called 'IJS.<task>'."""

DemonstrationName = Annotated[str, Field(pattern=LONG_NAME, examples=["grasp-1"])]
"""The same for a demonstration: '<task>-<number>', or what somebody calls the origin of samples."""

SampleNumber = Annotated[int, Field(ge=0, lt=2**63)]

LATEST = 1e9
"""World time in s that may be asked for: 30 years."""

MOST_AT_ONCE = 10_000
"""Samples or queries of one request."""

Key = Annotated[str, Field(pattern=r"^[!-~]{1,128}$", examples=["3f0c4c1e-6f0b-4a58-9d3e-4f3b7ad2b7f1"])]
"""An Idempotency-Key: up to 128 visible ASCII characters, such as a UUID."""


# Strict: neither "1" nor true is a number.
Number = Annotated[FiniteFloat, Strict()]

# They end at the first wrong value: one error for each of millions would fill the memory.
Vector = Annotated[tuple[Number, ...], FailFast(), Field(min_length=1, max_length=MOST_COMPONENTS)]
"""Numbers in the order in which a module declares its inputs or outputs."""


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Health(_Body):
    """The answer of /healthz and /readyz."""

    status: Literal["ok"] = "ok"


class Grab(_Body):
    """Which pictures will do."""

    not_older_than: Number = Field(default=0.0, ge=0.0, le=LATEST)
    """Oldest world time that the pictures may show, in s; 0: the newest there are."""


class ObjectInfo(_Body):
    """An object: how many stereo pairs without and with it are known, and whether it can be recognised."""

    name: str
    backgrounds: int
    examples: int
    learned: bool


class ObjectList(_Body):
    """The objects, in the order of their first pictures."""

    objects: tuple[ObjectInfo, ...]


class DemonstrationRequest(_Body):
    """What is going to be shown."""

    task: Name
    object: Name


class SubtaskInfo(_Body):
    """A subtask of a demonstration or of a trained task."""

    name: str
    action: Action | None
    """What the gripper does at the end."""


class DemonstrationInfo(_Body):
    """A demonstration so far."""

    id: str
    task: str
    object: str
    state: Literal["recording", "finished"]
    outcome: Outcome | None
    """What a person said of it; failures are not trained from."""
    created: datetime
    observations: int
    subtasks: tuple[SubtaskInfo, ...]


class DemonstrationPage(_Body):
    """Demonstrations, in the order they were begun."""

    demonstrations: tuple[DemonstrationInfo, ...]
    next: str | None
    """The cursor of the next page; null at the end."""


class OutcomeRequest(_Body):
    """What a person says of a demonstration."""

    outcome: Outcome | None


class ObservationRequest(_Body):
    """Look now, with the arm at rest."""

    subtask: Name
    goal: StrictBool = False
    """These joints are where the subtask ends."""
    key: StrictBool = False
    """One of the thesis's bare pairs: where the subtask begins."""


class ObservationInfo(_Body):
    """What was recognised and read."""

    number: int
    """Counts the demonstration's observations, from 0."""
    subtask: str
    goal: bool
    key: bool
    world_time: float
    """World time that the left picture shows, in s."""
    object: Triple
    """(row, column, disparity) in pixels."""
    hand: Triple
    """(row, column, disparity) in pixels."""
    joints: tuple[float, ...]
    """In rad, base to wrist."""


class ObservationList(_Body):
    """What was observed in a demonstration, in order."""

    observations: tuple[ObservationInfo, ...]


class ActionRequest(_Body):
    """What the person did with the gripper at the end of a subtask."""

    subtask: Name
    action: Action


class TaskInfo(_Body):
    """A trained task: its subtasks in order, the module that answers in them, and whom it was taught by."""

    name: str
    module: str
    subtasks: tuple[SubtaskInfo, ...]
    demonstrations: tuple[str, ...]


class TaskList(_Body):
    """The trained tasks, by name."""

    tasks: tuple[TaskInfo, ...]


class JobPage(_Body):
    """Jobs, newest first."""

    jobs: tuple[JobView, ...]
    next: str | None
    """The cursor of the next page; null at the end."""


class RunRequest(_Body):
    """What to do the task with."""

    object: Name
    one_look: StrictBool = False
    """One answer per subtask without looking again, as the thesis does."""


class StopRequest(_Body):
    """Why to stop."""

    reason: str = Field(default="a person asked for it", max_length=200)


class ModuleInfo(_Body):
    """A module: what it is, and how much it was taught."""

    name: str
    declaration: ModuleDeclaration
    samples: int
    demonstrations: int
    """From how many demonstrations the samples came."""
    created: datetime


class NewModule(ModuleDeclaration):
    """A module to be."""

    name: ModuleName


class ModulePage(_Body):
    """Modules, by name."""

    modules: tuple[ModuleInfo, ...]
    next: str | None
    """The cursor of the next page; null at the end."""


class Sample(_Body):
    """One example: input and output vector in the declared order and units."""

    input: Vector
    output: Vector
    demonstration: DemonstrationName | None = None
    """What it came from; samples of one demonstration are left out together when support is calibrated."""


class SamplesRequest(_Body):
    """Samples to be learned; all of them or none."""

    samples: Annotated[tuple[Sample, ...], FailFast()] = Field(min_length=1, max_length=MOST_AT_ONCE)


class SamplesAdded(_Body):
    """What was learned: the samples have the numbers first … first + count - 1."""

    first: int
    count: int
    samples: int
    """How many the module has now."""


class SampleInfo(_Body):
    """A sample as it is stored."""

    number: int
    input: tuple[float, ...]
    output: tuple[float, ...]
    demonstration: str | None


class SamplePage(_Body):
    """Samples, by number."""

    samples: tuple[SampleInfo, ...]
    next: str | None
    """The cursor of the next page; null at the end."""


class SamplesRemoved(_Body):
    """How many samples were taken out."""

    removed: int


class QueryRequest(_Body):
    """One query or many, each a vector in the declared order and units."""

    inputs: Annotated[tuple[Vector, ...], FailFast()] = Field(min_length=1, max_length=MOST_AT_ONCE)
    neighbours: int = Field(default=10, ge=0, le=1000, strict=True)
    """So many of the samples that each answer came from are named, nearest first."""


class NeighbourInfo(_Body):
    """A sample that an answer came from."""

    sample: int
    demonstration: str | None
    distance: float
    """From the query, after each component was divided by its scale."""
    weight: float
    """Its share in the answer; those of all samples add up to 1."""


class AnswerInfo(_Body):
    """What a module says to one query."""

    output: tuple[float, ...]
    """In the declared order and units."""
    support: float
    """1: amid what was taught; 1/2: as far from it as one demonstration is from the others; towards 0: outside."""
    expected_error: tuple[float | None, ...]
    """What the error of each output should not exceed in nine of ten cases; null while that is not known."""
    neighbours: tuple[NeighbourInfo, ...]


class AnswerList(_Body):
    """The answers, in the order of the queries."""

    answers: tuple[AnswerInfo, ...]


class RetrainRequest(_Body):
    """How the module is to answer from now on; null: as before."""

    approximator: ApproximatorSettings | None = None


class TreeNode(_Body):
    """A node of a tree; node 0 is the root, which holds no point."""

    number: int
    parent: int | None
    level: int
    children: int
    samples: int
    """That a leaf keeps."""
    point: tuple[float, ...] | None
    """The input it stands for, in the declared units."""


class TreeInfo(_Body):
    """A module's tree, breadth first."""

    components: tuple[str, ...]
    """What the points' numbers are."""
    radii: tuple[float, ...]
    """T(1) > T(2) > ..., in scaled units."""
    nodes: tuple[TreeNode, ...]
    truncated: bool
    """There are more nodes."""


class SnapshotRequest(_Body):
    """What to call it."""

    name: Name


class SnapshotInfo(_Body):
    """A module as it was at one moment."""

    name: str
    samples: int
    created: datetime


class SnapshotList(_Body):
    """A module's snapshots, oldest first."""

    snapshots: tuple[SnapshotInfo, ...]


class RobotDescriptionInfo(_Body):
    """What the robot is; does not change."""

    joint_names: tuple[str, ...]
    """Base to wrist."""
    lower: tuple[float, ...]
    """In rad."""
    upper: tuple[float, ...]
    """In rad."""
    speed: tuple[float, ...]
    """Limits, in rad/s."""
    acceleration: tuple[float, ...]
    """Limits, in rad/s²."""
    park: tuple[float, ...]
    """Park position, in rad."""
    gripper_range: float
    """Greatest distance between the finger pads, in m."""
    clock: Literal["realtime", "lockstep"]
    """In lockstep, world time advances only by moves and `advance`."""


class LeaseRequest(_Body):
    """Who wants control, for messages to others."""

    holder: Name


class LeaseKept(_Body):
    """Who has control, and how long without another sign of life."""

    holder: str
    expires_after: float
    """In s."""


class LeaseGiven(LeaseKept):
    """The control lease."""

    lease: str
    """A secret: send it in the header Control-Lease."""


class PaceRequest(_Body):
    """How fast to move, as shares of the joints' limits."""

    speed: Number = Field(default=0.5, ge=0.001, le=1.0)
    acceleration: Number = Field(default=0.5, ge=0.001, le=1.0)


class Paced(_Body):
    """A motion, and how fast."""

    pace: PaceRequest = PaceRequest()


class MoveToPoint(Paced):
    """Where the tool centre point is to go."""

    point: Annotated[tuple[Number, Number, Number], THREE]
    """(x, y, z) in m, world frame."""


class MoveToJoints(Paced):
    """Where the joints are to go."""

    joints: Annotated[tuple[Number, ...], Field(min_length=1, max_length=32)]
    """In rad, base to wrist."""


class AdjustJoints(Paced):
    """How far the joints are to turn."""

    delta: Annotated[tuple[Number, ...], Field(min_length=1, max_length=32)]
    """In rad, base to wrist."""


class Advance(_Body):
    """How much world time is to pass."""

    duration: Number = Field(gt=0.0, le=60.0)
    """In s."""


class TurnHead(_Body):
    """Where the head is to point."""

    pan: Number
    """In rad; positive to its left."""
    tilt: Number
    """In rad; positive upwards."""


class HeadDescription(HeadInfo):
    """Where the head points, and how far, how finely and how fast it turns: rad, rad/s."""

    pan_lower: float
    pan_upper: float
    tilt_lower: float
    tilt_upper: float
    step: float
    speed: float


class Restored(_Body):
    """What the store has now."""

    modules: int
    samples: int
