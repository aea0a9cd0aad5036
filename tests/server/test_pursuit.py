"""Pursuit of something that moves, by looks that come late, without robot, pictures or bus."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from handeye.camera_bridge.driver import Course, Frame, HeadState, StereoPair
from handeye.camera_bridge.turning import Track
from handeye.modules.recognition import NotSeen
from handeye.modules.spaces import HeadTurn, ImagePoint
from handeye.server.acting import OutsideTaughtRegion
from handeye.server.job import Job, JobCancelled
from handeye.server.pursuit import ObjectLost, Pursuit, PursuitSettings
from handeye.server.results import PursuitResult

FOCAL = 600.0  # px
MIDDLE = 23.5, 31.5  # px
LATENCY = 0.05  # s from exposure to when a picture can be had
RANGES = ((-3.0, 3.0), (-1.5, 0.8))
IMAGE = np.zeros((48, 64, 3), np.uint8)

Way = Callable[[float], tuple[float, float]]
"""The direction (pan, tilt) in rad that something is in at a world time in s."""


class Sky:
    """Something that moves, a head that turns after it, and eyes that see it late: looker, eyes, chain and job."""

    def __init__(self, way: Way, takes: float = 0.6) -> None:
        self.way = way
        self.takes = takes
        self.time = 5.0
        self.track = Track((0.0, -0.5), 0.0009, 1.7, 3.5)
        self.hidden: Callable[[float], bool] = lambda _time: False
        self.support = 1.0
        self.cancelled_at = math.inf
        self.result: PursuitResult | None = None
        self.looks = 0
        self.shares: list[float] = []

    # The looker

    def glance(self, newer_than: float | None, period: float) -> StereoPair:
        exposure = self.time - LATENCY
        assert newer_than is None or exposure > newer_than
        self.time += self.takes  # rendering, or what else keeps pictures waiting
        (pan, tilt), moving = self.track.at(exposure)
        frame = Frame(IMAGE, exposure, 0)
        return StereoPair(frame, frame, 0.0, HeadState(pan, tilt, moving, exposure))

    def follow(self, course: Course, lasting: float) -> HeadState:
        self.track.follow(self.time, course, lasting, RANGES)
        return self._state()

    def halt(self) -> None:
        here = self._state()
        self.follow(Course(here.pan, here.tilt, 0.0, 0.0, here.world_time), 0.0)

    def _state(self) -> HeadState:
        (pan, tilt), moving = self.track.at(self.time)
        return HeadState(pan, tilt, moving, self.time)

    # Eyes and chain: what the ones see, the other undoes

    def find(self, pair: StereoPair, name: str | None) -> ImagePoint:
        assert name == "cup"
        if self.hidden(pair.left.world_time):
            raise NotSeen("the cup is not seen")
        pan, tilt = self.way(pair.left.world_time)
        row = MIDDLE[0] - FOCAL * math.tan(tilt - pair.head.tilt)
        return ImagePoint(row, MIDDLE[1] - FOCAL * math.tan(pan - pair.head.pan), 150.0)

    def to_head(self, point: ImagePoint, tilt: float) -> tuple[HeadTurn, Any]:
        turn = HeadTurn(math.atan((MIDDLE[1] - point.column) / FOCAL), math.atan((MIDDLE[0] - point.row) / FOCAL))
        return turn, SimpleNamespace(answer=SimpleNamespace(support=self.support))

    # The job

    def check(self) -> None:
        if self.time > self.cancelled_at:
            raise JobCancelled("the job was cancelled")

    def report(self, share: float) -> None:
        self.shares.append(share)

    def publish(self, kind: str, data: dict[str, Any], result: None) -> None:
        assert (kind, data["number"]) == ("look", self.looks)
        self.looks += 1

    def finish(self, result: PursuitResult) -> None:
        assert len(result.looks) == self.looks
        self.result = result

    def pursue(self, duration: float, settings: PursuitSettings | None = None) -> list[float | None]:
        """Pursues; the offsets of all looks in px."""
        there = cast(Any, self)
        job = cast(Job, self)
        Pursuit("cup", duration, there, there, there, settings or PursuitSettings(), job).execute()
        return self.offsets

    @property
    def offsets(self) -> list[float | None]:
        assert self.result is not None
        return [look.offset for look in self.result.looks]

    def stands_still(self) -> bool:
        """Once it had the time to slow down."""
        self.time += 1.0
        return not self._state().moving


def even(time: float) -> tuple[float, float]:
    """80 px a second."""
    return 0.2 + 0.12 * (time - 5.0), -0.45 + 0.06 * (time - 5.0)


def most(offsets: list[float | None]) -> float:
    return max(math.inf if offset is None else offset for offset in offsets)


def test_an_even_motion_is_in_the_middle_of_every_picture_however_late() -> None:
    for takes in (0.05, 0.6, 1.2):
        sky = Sky(even, takes)
        offsets = sky.pursue(8.0)
        # A look to see it, another to see it move, and the time that the head takes.
        assert most(offsets[:2]) > 50.0
        assert sky.result is not None
        settled = [o for each, o in zip(sky.result.looks, offsets, strict=True) if each.world_time > 6.5 + 3 * takes]
        assert len(settled) >= 3
        assert most(settled) < 3.0
        assert sky.stands_still()
        last = sky.result.looks[-1]
        assert last.late == pytest.approx(takes + LATENCY)
        assert last.rate == pytest.approx((0.12, 0.06), abs=0.01)
        assert last.world_time >= sky.result.looks[0].world_time + 8.0
        assert sky.shares[-1] >= 1.0


def test_what_stands_still_is_looked_at_and_no_more() -> None:
    offsets = Sky(lambda _time: (0.1, -0.3)).pursue(5.0)
    assert most(offsets[3:]) < 1.0


def test_it_turns_round_when_the_object_does() -> None:
    sky = Sky(lambda time: (0.1 * min(time - 5.0, 15.0 - time), -0.5), 0.5)
    offsets = sky.pursue(9.0)
    assert sky.result is not None
    worst = [offset or 0.0 for look, offset in zip(sky.result.looks, offsets, strict=True) if look.world_time > 10.0]
    assert max(worst) > 20.0  # nobody told it
    assert most(offsets[-3:]) < 3.0


def test_it_goes_on_unseen_for_a_while_and_finds_it_again() -> None:
    sky = Sky(even, 0.4)
    sky.hidden = lambda time: 8.0 < time < 9.2
    offsets = sky.pursue(8.0)
    missing = [number for number, offset in enumerate(offsets) if offset is None]
    assert len(missing) >= 2
    assert most(offsets[missing[-1] + 1 :]) < 6.0
    assert sky.result is not None
    assert sky.result.looks[missing[0]].rate == sky.result.looks[missing[0] - 1].rate


def test_what_is_not_seen_for_too_long_is_lost_and_the_head_stands_still() -> None:
    sky = Sky(even, 0.4)
    sky.hidden = lambda time: time > 8.0
    with pytest.raises(ObjectLost, match=r"'cup' is lost: for 2\.\d s"):
        sky.pursue(20.0)
    assert sky.stands_still()
    assert sky.time < 12.5
    assert sky.offsets[-1] is None


def test_what_is_not_seen_at_first_is_not_followed() -> None:
    sky = Sky(even)
    sky.hidden = lambda _time: True
    with pytest.raises(NotSeen):
        sky.pursue(20.0)
    assert sky.offsets == [None]
    assert sky.track.at(sky.time)[0] == pytest.approx((0.0, -0.5), abs=1e-3)


def test_it_does_not_turn_by_answers_without_support() -> None:
    sky = Sky(even)
    sky.support = 0.05
    with pytest.raises(OutsideTaughtRegion, match=r"support 0\.05"):
        sky.pursue(20.0)
    assert sky.result is not None
    assert sky.result.looks[-1].support == 0.05
    assert sky.result.looks[-1].rate == ()
    assert sky.stands_still()


def test_a_cancelled_pursuit_leaves_the_head_at_rest() -> None:
    sky = Sky(even, 0.3)
    sky.cancelled_at = 8.0
    with pytest.raises(JobCancelled):
        sky.pursue(20.0)
    assert sky.stands_still()
    assert sky.time < 9.5
