"""The bodies of demonstrations: what is shown, observed, done by the gripper, and said of it afterwards."""

from __future__ import annotations

from datetime import datetime
from typing import Literal

from pydantic import StrictBool

from handeye.server.demonstration import Action, Outcome
from handeye.server.results import Triple
from handeye.server.schemas.base import Body, MarkedPoint, Name


class DemonstrationRequest(Body):
    """What is going to be shown."""

    task: Name
    object: Name


class SubtaskInfo(Body):
    """A subtask of a demonstration or of a trained task."""

    name: str
    action: Action | None
    """What the gripper does at the end."""
    object: str | None
    """What it is towards; null: the object that the task is done with."""
    way: tuple[float, ...]
    """World time in s that passes on the way to each of its way-points, which nobody looks at."""


class DemonstrationInfo(Body):
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


class DemonstrationPage(Body):
    """Demonstrations, in the order they were begun."""

    demonstrations: tuple[DemonstrationInfo, ...]
    next: str | None
    """The cursor of the next page; null at the end."""


class OutcomeRequest(Body):
    """What a person says of a demonstration."""

    outcome: Outcome | None


class ObservationRequest(Body):
    """Look now, with the arm at rest."""

    subtask: Name
    object: Name | None = None
    """What the subtask is towards; null: the demonstration's object."""
    goal: StrictBool = False
    """These joints are where the subtask ends."""
    key: StrictBool = False
    """One of the thesis's bare pairs: where the subtask begins."""
    object_at: MarkedPoint | None = None
    """(row, column, disparity) of the object's middle in pixels, as a person has marked it in pictures since which
    neither it nor the head has moved; then only the hand is looked for. Null: the object is looked for, too."""


class ObservationInfo(Body):
    """What was recognised and read."""

    number: int
    """Counts the demonstration's observations, from 0."""
    subtask: str
    towards: str
    """The object that the subtask is towards."""
    goal: bool
    key: bool
    world_time: float
    """World time that the left picture shows, or at which a way-point was told, in s."""
    object: Triple | None
    """(row, column, disparity) in pixels; null: a way-point, at which nobody looked."""
    hand: Triple | None
    """(row, column, disparity) in pixels; null: a way-point."""
    joints: tuple[float, ...]
    """In rad, base to wrist."""
    seconds: float
    """Of a way-point: world time that passed on the way there, in s."""


class ObservationList(Body):
    """What was observed in a demonstration, in order."""

    observations: tuple[ObservationInfo, ...]


class WaypointRequest(Body):
    """The arm passes here, after the subtask's goal."""

    subtask: Name


class ActionRequest(Body):
    """What the person did with the gripper at the end of a subtask."""

    subtask: Name
    action: Action
