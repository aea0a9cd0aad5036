"""Active vision by module SCS: the head turns until an object, or the hand, is in the middle of the left picture."""

from __future__ import annotations

import math

from pydantic import BaseModel, ConfigDict, Field

from handeye.camera_bridge.driver import StereoPair
from handeye.modules.spaces import HeadAngles, HeadTurn, ImagePoint
from handeye.server.acting import OutsideTaughtRegion
from handeye.server.chain import Chain, Said
from handeye.server.eyes import Eyes
from handeye.server.job import Job
from handeye.server.looking import Looker
from handeye.server.problem import Conflict
from handeye.server.results import GazeLook, GazeResult


class NotCentred(Conflict):
    """The saccades have run out and the object is not in the middle of the picture."""

    code = "not_centred"


class GazeSettings(BaseModel):
    """How the head is turned to something."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    max_saccades: int = Field(default=4, ge=1)
    tolerance: float = Field(default=1.0, gt=0.0)
    """So near to the middle of the left picture it is centred, in px."""
    acceptable: float = Field(default=3.0, gt=0.0)
    """When the saccades have run out this is near enough, in px."""
    least_support: float = Field(default=0.1, ge=0.0, le=1.0)
    """An answer with less support is not turned by."""


class Gaze:
    """One turn of the head to something, repeated until it is centred. `execute` may be called once."""

    def __init__(self, chain: Chain, looker: Looker, eyes: Eyes, settings: GazeSettings, job: Job) -> None:
        self._chain = chain
        self._looker = looker
        self._eyes = eyes
        self._settings = settings
        self._job = job
        self._looks: list[GazeLook] = []

    def execute(self, object_name: str | None) -> None:
        """Centres the object of that name, or the hand for None.

        `NotSeen` when it is not in both pictures, `OutsideTaughtRegion` when support is low, `NotCentred` when it is
        still too far from the middle after the last saccade.
        """
        for _ in range(self._settings.max_saccades):
            if self._step(object_name, turning=True) <= self._settings.tolerance:
                return
        if (offset := self._step(object_name, turning=False)) > self._settings.acceptable:
            raise NotCentred(
                f"It is {offset:.1f} px from the middle of the picture after {self._settings.max_saccades} saccades; "
                "collect more samples of module 'SCS' from such poses of the head."
            )

    def _step(self, object_name: str | None, *, turning: bool) -> float:
        """One look and, unless it is centred, one saccade; how far from the middle it was seen, in px."""
        self._job.check()
        _, pair = self._looker.look()
        point = self._eyes.find(pair, object_name)
        offset = from_middle(pair, point)
        if offset <= self._settings.tolerance or not turning:
            self._record(pair, point, offset, None, 1.0)
            return offset
        turn, said = self._chain.to_head(point, pair.head.tilt)
        self._record(pair, point, offset, turn, said.answer.support)
        require_support(said, point, pair.head.tilt, self._settings.least_support)
        self._looker.turn(HeadAngles(pair.head.pan + turn.pan, pair.head.tilt + turn.tilt))
        return offset

    def _record(
        self, pair: StereoPair, point: ImagePoint, offset: float, turn: HeadTurn | None, support: float
    ) -> None:
        look = GazeLook(
            number=len(self._looks),
            world_time=pair.left.world_time,
            point=(point.row, point.column, point.disparity),
            offset=offset,
            pan=pair.head.pan,
            tilt=pair.head.tilt,
            turn=() if turn is None else (turn.pan, turn.tilt),
            support=support,
        )
        self._looks.append(look)
        result = GazeResult(looks=tuple(self._looks), middle=middle(pair))
        self._job.publish("look", look.model_dump(mode="json"), result)


def require_support(said: Said, point: ImagePoint, tilt: float, least: float) -> None:
    """`OutsideTaughtRegion` when SCS's answer for a point, the head at `tilt` rad, has less support than `least`."""
    if said.answer.support < least:
        raise OutsideTaughtRegion(
            f"Module 'SCS' was not taught for row {point.row:.0f}, column {point.column:.0f}, disparity "
            f"{point.disparity:.0f} at a tilt of {tilt:.2f} rad (support {said.answer.support:.2f}, at least "
            f"{least:.2f} is asked for): collect samples there."
        )


def middle(pair: StereoPair) -> tuple[float, float]:
    """(row, column) of the middle of the left picture, in px."""
    rows, columns = pair.left.image.shape[:2]
    return (rows - 1) / 2, (columns - 1) / 2


def from_middle(pair: StereoPair, point: ImagePoint) -> float:
    """How far a point is from the middle of the left picture, in px."""
    row, column = middle(pair)
    return math.hypot(point.row - row, point.column - column)
