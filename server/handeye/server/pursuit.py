"""Smooth pursuit by module SCS: the head turns along with an object that moves, and keeps it in the middle.

A look tells, late, in which direction the object was: where the head pointed when the picture was taken, and SCS's
turn. From these directions comes the course that the head follows, as it goes on between looks: nothing but pictures
and the head's encoders. No look waits for the head to stand still.
"""

from __future__ import annotations

from contextlib import suppress

from pydantic import BaseModel, ConfigDict, Field

from handeye.camera_bridge.driver import LONGEST_FOLLOW, StereoPair
from handeye.modules.recognition import NotSeen
from handeye.modules.spaces import HeadAngles
from handeye.rpc.errors import RpcError
from handeye.server.acting import OutsideTaughtRegion
from handeye.server.chain import Chain
from handeye.server.eyes import Eyes
from handeye.server.gaze import from_middle, middle, require_support
from handeye.server.job import Job
from handeye.server.looking import Looker
from handeye.server.problem import Conflict
from handeye.server.results import PursuitLook, PursuitResult
from handeye.server.tracking import Tracker


class ObjectLost(Conflict):
    """The object has not been seen for too long: nobody knows where it is."""

    code = "object_lost"


class PursuitSettings(BaseModel):
    """How the head follows something."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    noise: float = Field(default=0.002, gt=0.0)
    """By so much a direction is uncertain that a look tells, in rad: a pixel is 0.0017 rad."""
    agility: float = Field(default=0.02, gt=0.0)
    """How much rates change in a second, as a variance, in rad²/s³."""
    least_support: float = Field(default=0.1, ge=0.0, le=1.0)
    """An answer with less support is not turned by."""
    lost_after: float = Field(default=2.0, gt=0.0)
    """So long the head goes on while pictures come in which the object is not seen, in s of world time; then it is
    lost."""
    coast: float = Field(default=LONGEST_FOLLOW, gt=0.0, le=LONGEST_FOLLOW)
    """So long the head goes on by itself when no picture comes, in s of world time: more than looks take."""
    period: float = Field(default=0.1, gt=0.0)
    """World time from look to look in lockstep, in s; with the realtime clock looks come as fast as they can."""


class Pursuit:
    """One pursuit. `execute` may be called once."""

    def __init__(
        self,
        object_name: str,
        duration: float,
        chain: Chain,
        looker: Looker,
        eyes: Eyes,
        settings: PursuitSettings,
        job: Job,
    ) -> None:
        """Of the object of that name, for `duration` s of world time."""
        self._object = object_name
        self._duration = duration
        self._chain = chain
        self._looker = looker
        self._eyes = eyes
        self._settings = settings
        self._job = job
        self._tracker = Tracker(settings.noise, settings.agility)
        self._seen = False
        """Whether the object was seen at all."""
        self._missing: float | None = None
        """World time of the first picture since it was seen last, in s; None while it is seen."""
        self._looks: list[PursuitLook] = []
        self._middle: tuple[float, ...] = ()
        """(row, column) of the middle of the left picture, in px; empty before the first look."""

    def execute(self) -> None:
        """Follows the object until the time is over; then the head stands still, on any error too.

        `NotSeen` when it is not in the first pictures, `ObjectLost` when it has not been seen for too long,
        `OutsideTaughtRegion` when support is low, `OutOfLimits` when it is where the head cannot turn to.
        """
        try:
            pair = self._looker.glance(None, self._settings.period)
            ends = pair.left.world_time + self._duration
            while True:
                self._step(pair)
                self._job.report(1.0 - (ends - pair.left.world_time) / self._duration)
                if pair.left.world_time >= ends:
                    return
                self._job.check()
                pair = self._looker.glance(pair.left.world_time, self._settings.period)
        finally:
            with suppress(RpcError):  # the head stops by itself, a little later
                self._looker.halt()
            looks = tuple(self._looks)
            self._job.finish(PursuitResult(duration=self._duration, looks=looks, middle=self._middle))

    def _step(self, pair: StereoPair) -> None:
        try:
            point = self._eyes.find(pair, self._object)
        except NotSeen as missing:
            self._not_seen(pair, missing)
            return
        turn, said = self._chain.to_head(point, pair.head.tilt)
        look = self._look(pair).model_copy(
            update={
                "point": (point.row, point.column, point.disparity),
                "offset": from_middle(pair, point),
                "turn": (turn.pan, turn.tilt),
                "support": said.answer.support,
            }
        )
        try:
            require_support(said, point, pair.head.tilt, self._settings.least_support)
        except OutsideTaughtRegion:
            self._record(look)
            raise
        self._seen, self._missing = True, None
        direction = HeadAngles(pair.head.pan + turn.pan, pair.head.tilt + turn.tilt)
        self._tracker.see(direction, pair.left.world_time)
        self._follow(pair, look)

    def _not_seen(self, pair: StereoPair, missing: NotSeen) -> None:
        """The head goes on as the object did, and may find it again."""
        look = self._look(pair)
        if self._missing is None:
            self._missing = pair.left.world_time
        gone = pair.left.world_time - self._missing
        if self._seen and gone <= self._settings.lost_after:
            self._follow(pair, look)
            return
        self._record(look)
        if not self._seen:
            raise missing
        raise ObjectLost(
            f"Object '{self._object}' is lost: for {gone:.1f} s it was not in the pictures, though the head went on as "
            f"it had moved; at last {missing}."
        ) from missing

    def _follow(self, pair: StereoPair, look: PursuitLook) -> None:
        course = self._tracker.course
        told = self._looker.follow(course, self._settings.coast)
        late = told.world_time - pair.left.world_time
        self._record(look.model_copy(update={"rate": (course.pan_rate, course.tilt_rate), "late": late}))

    def _look(self, pair: StereoPair) -> PursuitLook:
        """A look in which nothing is seen yet."""
        self._middle = middle(pair)
        return PursuitLook(
            number=len(self._looks),
            world_time=pair.left.world_time,
            pan=pair.head.pan,
            tilt=pair.head.tilt,
        )

    def _record(self, look: PursuitLook) -> None:
        self._looks.append(look)
        # Not with the result: to write down all looks with each of them takes ever longer.
        self._job.publish("look", look.model_dump(mode="json"), None)
