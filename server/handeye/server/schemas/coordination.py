"""The bodies of reaching, gazing and collecting."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from handeye.server.collecting.fixating import Keep
from handeye.server.results import THREE
from handeye.server.schemas.base import LATEST, Body, MarkedPoint, Name, Number

_Metres = Annotated[Number, Field(ge=-100.0, le=100.0)]
_Share = Annotated[Number, Field(ge=-1.0, le=1.0)]

Place = Annotated[tuple[_Metres, _Metres, _Metres], THREE]


class LookRequest(Body):
    """What to look for."""

    object: Name | None = None
    """Null: the hand."""
    not_older_than: Number = Field(default=0.0, ge=0.0, le=LATEST)
    """World time in s that the pictures show at the earliest."""


class LookInfo(Body):
    """Where something is seen, and from where."""

    point: Annotated[tuple[float, float, float], THREE]
    """(row, column, disparity) in pixels."""
    confidence: float
    """How surely it is that, in [0, 1]."""
    pan: float
    """Where the head pointed, in rad."""
    tilt: float
    """In rad."""
    world_time: float
    """World time that the left picture shows, in s."""


class ReachRequest(Body):
    """Where the hand is to go: to an object, or to a point of the stereo image that somebody marked."""

    object: Name | None = None
    point: MarkedPoint | None = None
    """(row, column, disparity) in pixels, for the head as it stands."""
    one_look: bool = Field(default=False, strict=True)
    """Move once, by one look, and do not check."""
    gaze: bool = Field(default=False, strict=True)
    """Turn the head to the object first, by SCS, so that it is in the middle of the left picture."""

    @model_validator(mode="after")
    def _one_of_them(self) -> ReachRequest:
        if (self.object is None) == (self.point is None):
            raise ValueError("give an object or a point, one of them")
        if self.gaze and self.object is None:
            raise ValueError("a point is meant for the head as it stands: gaze goes with an object")
        return self


class GazeRequest(Body):
    """What the head is to be turned to."""

    object: Name | None = None
    """Null: the hand."""


class PursuitRequest(Body):
    """What the head is to follow."""

    object: Name
    duration: Number = Field(gt=0.0, le=120.0)
    """How long, in s of world time; cancel the job to end it before."""


class FixationRequest(Body):
    """What to fixate, and which looks to learn SCS from."""

    object: Name
    keep: Keep = "all"


class PosturesRequest(Body):
    """How the arm is to babble, and which modules learn from it."""

    modules: Annotated[tuple[Literal["AJS", "CAS", "IJS"], ...], Field(min_length=1, max_length=3)]
    postures: int = Field(default=300, ge=1, le=100_000, strict=True)
    """How many there are to be, those of earlier times included: ask again to go on where it ended."""
    looks: int = Field(default=3, ge=1, le=20, strict=True)
    """From so many poses of the head the hand is looked at in each posture, for CAS."""
    lower: Place = (0.31, -0.29, 0.03)
    """Corner of the region in which the arm's point is to be, (x, y, z) in m, world frame: a few centimetres more than
    what is to be reached afterwards."""
    upper: Place = (0.89, 0.29, 0.39)
    """The opposite corner."""
    synergies: Annotated[
        tuple[Annotated[tuple[_Share, ...], Field(min_length=1, max_length=32)], ...],
        Field(min_length=1, max_length=32),
    ] = ((1.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0, -1.0, 0.0), (0.0, 0.0, 1.0, 0.0, -1.0, 0.0))
    """Directions in joint space along which the arm moves. These keep a PUMA's hand at its pitch: joint 5 takes back
    what joints 2 and 3 do."""
    seed: int = Field(default=1, ge=0, le=2**31, strict=True)
    """Of the random motions."""

    @model_validator(mode="after")
    def _check(self) -> PosturesRequest:
        if len(set(self.modules)) < len(self.modules):
            raise ValueError("a module is named twice")
        if not all(low < high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError("each component of lower must be less than that of upper")
        if any(not any(direction) for direction in self.synergies):
            raise ValueError("a synergy must turn at least one joint")
        return self


class GridViewRequest(Body):
    """Where the grid's intersections are while it is looked at."""

    points: Annotated[
        tuple[Annotated[tuple[Place, ...], Field(min_length=3, max_length=100)], ...],
        Field(min_length=3, max_length=100),
    ]
    """Row by row as the left camera sees them, the first one at the upper left: (x, y, z) in m in its frame, x to the
    right, y down, z forward."""
    every: int = Field(default=1, ge=1, le=10, strict=True)
    """Only every so manyth row and column is learned: neighbouring intersections say much the same, and samples that
    crowd in one plane leave no room among the neighbours for those of others."""
    not_older_than: Number = Field(default=0.0, ge=0.0, le=LATEST)
    """World time in s that the pictures show at the earliest: the grid must be at rest then."""

    @model_validator(mode="after")
    def _check_rows(self) -> GridViewRequest:
        if len({len(row) for row in self.points}) > 1:
            raise ValueError("all rows of points must be of one length")
        return self
