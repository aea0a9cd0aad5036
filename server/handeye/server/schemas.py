"""The bodies of requests and answers of the REST interface. Unknown keys are refused."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from handeye.server.demonstrations import Action

Name = Annotated[str, Field(pattern=r"^\w[\w .-]{0,62}$", examples=["blue cup"])]
"""A name of an object, task or subtask: letters, digits, '_', '.', '-', and spaces; at most 63 characters."""


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Health(_Body):
    """The answer of /healthz and /readyz."""

    status: Literal["ok"] = "ok"


class Grab(_Body):
    """Which pictures will do."""

    not_older_than: float = Field(default=0.0, ge=0.0, allow_inf_nan=False)
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
    observations: int
    subtasks: tuple[SubtaskInfo, ...]


class DemonstrationList(_Body):
    """The demonstrations, in the order they were begun."""

    demonstrations: tuple[DemonstrationInfo, ...]


class ObservationRequest(_Body):
    """Look now, with the arm at rest."""

    subtask: Name
    goal: bool = False
    """These joints are where the subtask ends."""
    key: bool = False
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
    object: tuple[float, float, float]
    """(row, column, disparity) in pixels."""
    hand: tuple[float, float, float]
    """(row, column, disparity) in pixels."""
    joints: tuple[float, ...]
    """In rad, base to wrist."""


class ActionRequest(_Body):
    """What the person did with the gripper at the end of a subtask."""

    subtask: Name
    action: Action


class RunRequest(_Body):
    """What to do the task with."""

    object: Name
    one_look: bool = False
    """One answer per subtask without looking again, as the thesis does."""


class RobotInfo(_Body):
    """What the robot's own sensors say."""

    world_time: float
    """In s."""
    joints: tuple[float, ...]
    """In rad, base to wrist."""
    velocities: tuple[float, ...]
    """In rad/s."""
    gripper_opening: float
    """Between the pads, in m."""
    moving: bool
    stopped: bool
    """The software stop is latched; moves are refused until a reset."""
    still_since: float | None
    """World time since when arm and gripper stand still, in s; null while they move."""
    lease_holder: str
    """Who controls the robot; empty when nobody does."""


class StopRequest(_Body):
    """Why to stop."""

    reason: str = Field(default="a person asked for it", max_length=200)
