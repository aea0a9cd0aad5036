"""How a pan/tilt head turns: a trapezoid of speed on each axis, in whole steps, as a function of time.

Or after a course: as fast as it may until it is there, then along with it.

All angles in rad, times in s, speeds in rad/s, accelerations in rad/s^2.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from handeye.camera_bridge.driver import LONGEST_FOLLOW, Course
from handeye.rpc.errors import InvalidArgument, OutOfLimits

Angles = tuple[float, float]
"""(pan, tilt)."""

Range = tuple[float, float]
"""(lowest, highest)."""

_REMEMBERED = 1000
"""Motions that a track remembers: pictures are asked for of now, not of long ago."""


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn that begins at `start`; each axis speeds up, runs and slows down on its own."""

    start: float
    origin: Angles
    target: Angles
    speed: float
    acceleration: float

    @property
    def end(self) -> float:
        """When both axes stand still."""
        return self.start + max(
            _duration(abs(b - a), self.speed, self.acceleration) for a, b in zip(self.origin, self.target, strict=True)
        )

    def at(self, time: float) -> Angles:
        """Where the head points at a time, before, during and after the turn."""
        if time >= self.end:
            return self.target
        elapsed = time - self.start
        pan, tilt = (
            a + math.copysign(_travelled(elapsed, abs(b - a), self.speed, self.acceleration), b - a)
            for a, b in zip(self.origin, self.target, strict=True)
        )
        return pan, tilt


_TICK = 1.0 / 240.0
"""Chases are worked out in steps of so many s."""


@dataclass(frozen=True, slots=True)
class Chase:
    """A motion after a course, in small steps of time; at its end the head stands still."""

    start: float
    places: tuple[Angles, ...]
    """Where the head points at the start and every `_TICK` s from there on."""

    @property
    def origin(self) -> Angles:
        """Where it begins."""
        return self.places[0]

    @property
    def end(self) -> float:
        """When both axes stand still."""
        return self.start + (len(self.places) - 1) * _TICK

    def at(self, time: float) -> Angles:
        """Where the head points at a time, before, during and after the chase."""
        ticks = min(max((time - self.start) / _TICK, 0.0), len(self.places) - 1.0)
        before = int(ticks)
        after = min(before + 1, len(self.places) - 1)
        (pan, tilt), (next_pan, next_tilt) = self.places[before], self.places[after]
        share = ticks - before
        return pan + share * (next_pan - pan), tilt + share * (next_tilt - tilt)


class Track:
    """Where the head pointed at every time: at home, and its motions since."""

    def __init__(self, home: Angles, step: float, speed: float, acceleration: float) -> None:
        """`step`: smallest step of both axes, 0 for none."""
        self._home = home
        self._step = step
        self._speed = speed
        self._acceleration = acceleration
        self._turns: deque[Turn | Chase] = deque(maxlen=_REMEMBERED)

    @property
    def turned(self) -> bool:
        """Whether there was any motion."""
        return bool(self._turns)

    def at(self, time: float) -> tuple[Angles, bool]:
        """((pan, tilt) in whole steps, whether it turns) at a time."""
        for turn in reversed(self._turns):
            if time >= turn.start:
                return self._stepped(turn.at(time)), time < turn.end
        return self._stepped(self._turns[0].origin if self._turns else self._home), False

    def turn(self, now: float, target: Angles) -> Turn:
        """Begins a turn to `target`, rounded to the steps; a turn under way ends where it is."""
        origin, _ = self.at(now)
        turn = Turn(now, origin, self._stepped(target), self._speed, self._acceleration)
        self._begin(turn)
        return turn

    def follow(self, now: float, course: Course, lasting: float, ranges: tuple[Range, Range]) -> None:
        """Begins to chase `course` for `lasting` s, within `ranges` of pan and tilt; a motion under way goes over."""
        ticks = round(lasting / _TICK)
        ahead = [course.at(now + tick * _TICK) for tick in range(1, ticks + 1)]
        axes = [
            _chase(place, speed, [each[axis] for each in ahead], rate, ranges[axis], self._speed, self._acceleration)
            for axis, (place, speed, rate) in enumerate(
                zip(*self._motion(now), (course.pan_rate, course.tilt_rate), strict=True)
            )
        ]
        longest = max(map(len, axes))
        pan, tilt = (axis + [axis[-1]] * (longest - len(axis)) for axis in axes)
        self._begin(Chase(now, tuple(zip(pan, tilt, strict=True))))

    def _begin(self, motion: Turn | Chase) -> None:
        while self._turns and self._turns[-1].start >= motion.start:
            self._turns.pop()
        self._turns.append(motion)

    def _motion(self, now: float) -> tuple[Angles, Angles]:
        """Where it is on its way, between its steps, and how fast both axes turn."""
        newest = self._turns[-1] if self._turns else None
        if newest is None or now >= newest.end:
            return self.at(now)[0], (0.0, 0.0)
        here, before = newest.at(now), newest.at(now - _TICK)
        if now - _TICK < newest.start:
            before, here = here, newest.at(now + _TICK)
        speeds = (here[0] - before[0]) / _TICK, (here[1] - before[1]) / _TICK
        return newest.at(now), speeds

    def halt(self, now: float) -> None:
        """Stands still from `now` on, where it points then."""
        origin, moving = self.at(now)
        if moving:
            self.turn(now, origin)

    def clear(self) -> None:
        """Back home, as if it had never turned."""
        self._turns.clear()

    def _stepped(self, angles: Angles) -> Angles:
        pan, tilt = angles
        return to_step(pan, self._step), to_step(tilt, self._step)


def to_step(angle: float, step: float) -> float:
    """The angle rounded to whole steps; as it is when `step` is 0."""
    return round(angle / step) * step if step > 0.0 else angle


def check_limits(pan: float, tilt: float, pan_range: Range, tilt_range: Range) -> None:
    """`OutOfLimits` when an angle is no number or outside its range."""
    for name, angle, (lowest, highest) in (("pan", pan, pan_range), ("tilt", tilt, tilt_range)):
        if not lowest <= angle <= highest:
            raise OutOfLimits(
                f"the head cannot turn to {name} {angle:.4f} rad; its range is {lowest:.4f} to {highest:.4f} rad",
                detail=name,
            )


def _duration(distance: float, speed: float, acceleration: float) -> float:
    """How long a turn over `distance` takes from rest to rest."""
    if distance < speed**2 / acceleration:  # too short to reach the full speed
        return 2.0 * math.sqrt(distance / acceleration)
    return distance / speed + speed / acceleration


def check_course(course: Course, lasting: float, now: float, pan_range: Range, tilt_range: Range) -> None:
    """`InvalidArgument` for a course or `lasting` that nobody can follow, `OutOfLimits` when it is out of range now."""
    numbers = (course.pan, course.tilt, course.pan_rate, course.tilt_rate, course.world_time)
    if not all(map(math.isfinite, numbers)):
        raise InvalidArgument(f"a course has finite numbers only; got {numbers}", detail="course")
    if not 0.0 <= lasting <= LONGEST_FOLLOW:  # not true of nan
        raise InvalidArgument(
            f"a course is followed for 0 to {LONGEST_FOLLOW:g} s at a time, got {lasting}", detail="lasting"
        )
    check_limits(*course.at(now), pan_range, tilt_range)


def _chase(
    place: float,
    speed: float,
    ahead: list[float],
    rate: float,
    within: Range,
    greatest_speed: float,
    acceleration: float,
) -> list[float]:
    """Where one axis is every `_TICK`, from `place` at `speed`: after the places `ahead`, then braking.

    It closes in as fast as it can still slow down with half of its acceleration: the other half is for the course's own
    changes of speed.
    """
    most, places = acceleration * _TICK, [place]
    lowest, highest = within

    def go(wanted: float) -> None:
        nonlocal place, speed
        speed += min(max(wanted - speed, -most), most)
        if not lowest <= place + speed * _TICK <= highest:
            speed = 0.0
        place += speed * _TICK
        places.append(place)

    for goal in ahead:
        away = goal - rate * _TICK - place
        closing = min(math.sqrt(acceleration * abs(away)), abs(away) / (4.0 * _TICK))
        go(min(max(rate + math.copysign(closing, away), -greatest_speed), greatest_speed))
    while speed != 0.0:
        go(0.0)
    return places


def _travelled(elapsed: float, distance: float, speed: float, acceleration: float) -> float:
    """How much of `distance` is behind after `elapsed`."""
    duration = _duration(distance, speed, acceleration)
    if elapsed <= 0.0:
        return 0.0
    if elapsed >= duration:
        return distance
    speeding_up = min(speed / acceleration, duration / 2.0)
    if elapsed < speeding_up:
        return 0.5 * acceleration * elapsed**2
    if elapsed > duration - speeding_up:
        return distance - 0.5 * acceleration * (duration - elapsed) ** 2
    return acceleration * speeding_up * (elapsed - speeding_up / 2.0)
