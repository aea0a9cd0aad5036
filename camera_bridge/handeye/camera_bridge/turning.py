"""How a pan/tilt head turns: a trapezoid of speed on each axis, in whole steps, as a function of time.

All angles in rad, times in s, speeds in rad/s, accelerations in rad/s^2.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from handeye.rpc.errors import OutOfLimits

Angles = tuple[float, float]
"""(pan, tilt)."""

Range = tuple[float, float]
"""(lowest, highest)."""

_REMEMBERED = 1000
"""Turns that a track remembers: pictures are asked for of now, not of long ago."""


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


class Track:
    """Where the head pointed at every time: at home, and the turns since."""

    def __init__(self, home: Angles, step: float, speed: float, acceleration: float) -> None:
        """`step`: smallest step of both axes, 0 for none."""
        self._home = home
        self._step = step
        self._speed = speed
        self._acceleration = acceleration
        self._turns: deque[Turn] = deque(maxlen=_REMEMBERED)

    @property
    def turned(self) -> bool:
        """Whether there was any turn."""
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
        while self._turns and self._turns[-1].start >= now:
            self._turns.pop()
        self._turns.append(turn)
        return turn

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
