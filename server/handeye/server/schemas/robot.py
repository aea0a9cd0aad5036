"""The bodies of the robot and the head: what they are, who has control, where they are to go, and the stop."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from handeye.server.results import THREE, HeadInfo
from handeye.server.schemas.base import Body, Name, Number


class StopRequest(Body):
    """Why to stop."""

    reason: str = Field(default="a person asked for it", max_length=200)


class RobotDescriptionInfo(Body):
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


class LeaseRequest(Body):
    """Who wants control, for messages to others."""

    holder: Name


class LeaseKept(Body):
    """Who has control, and how long without another sign of life."""

    holder: str
    expires_after: float
    """In s."""


class LeaseGiven(LeaseKept):
    """The control lease."""

    lease: str
    """A secret: send it in the header Control-Lease."""


class PaceRequest(Body):
    """How fast to move, as shares of the joints' limits."""

    speed: Number = Field(default=0.5, ge=0.001, le=1.0)
    acceleration: Number = Field(default=0.5, ge=0.001, le=1.0)


class Paced(Body):
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


class Advance(Body):
    """How much world time is to pass."""

    duration: Number = Field(gt=0.0, le=60.0)
    """In s."""


class TurnHead(Body):
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
