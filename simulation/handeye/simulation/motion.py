"""Synchronised joint motions: a quintic profile along a straight line in joint space, and braking along it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from handeye.simulation import puma

Array = NDArray[np.float64]

# The quintic 10x³ − 15x⁴ + 6x⁵ from 0 to 1 in unit time: its greatest speed and acceleration.
_PEAK_SPEED = 1.875
_PEAK_ACCELERATION = 10.0 / math.sqrt(3.0)

_NOTHING = 1e-12  # rad: a joint that is to move less than this does not move


class JointMotion:
    """A motion from `start` to `goal` (6,), rad, that all joints begin and end together.

    Speed and acceleration stay under `speed_share` and `acceleration_share` of the joints' limits; both are zero at
    either end, and acceleration has no jumps. `advance` walks along it in fixed steps.
    """

    def __init__(
        self, start: Array, goal: Array, *, speed_share: float, acceleration_share: float, step: float
    ) -> None:
        self._start = start.copy()
        self._delta = np.where(np.abs(goal - start) < _NOTHING, 0.0, goal - start)
        distance = np.abs(self._delta)
        by_speed = np.max(_PEAK_SPEED * distance / (speed_share * puma.SPEED))
        by_acceleration = np.max(np.sqrt(_PEAK_ACCELERATION * distance / (acceleration_share * puma.ACCELERATION)))
        self._step = step
        self._steps = math.ceil(float(max(by_speed, by_acceleration)) / step)
        self._done = 0
        self._share = 0.0
        self._speed = 0.0
        self._deceleration = 0.0

    @property
    def duration(self) -> float:
        """How long the whole motion takes, in s."""
        return self._steps * self._step

    @property
    def finished(self) -> bool:
        """The end is reached, or the brake has brought it to a standstill."""
        return self._speed <= 0.0 if self._deceleration else self._done >= self._steps

    @property
    def fraction(self) -> float:
        """Share of the duration that has passed, 0..1."""
        return 1.0 if self._steps == 0 else min(1.0, self._done / self._steps)

    def advance(self) -> Array:
        """Walks one step on; returns the joint positions there (6,), rad."""
        if self._deceleration:
            self._slow_down()
        elif self._done < self._steps:
            self._done += 1
            x = self._done / self._steps
            self._share = x**3 * (10.0 + x * (6.0 * x - 15.0))
            self._speed = 30.0 * x**2 * (1.0 - x) ** 2 / self.duration
        return self._start + self._share * self._delta

    def brake(self) -> None:
        """From here on slows down along the path as fast as the joints' acceleration limits allow."""
        if self.finished or self._deceleration:
            return
        moved = np.abs(self._delta) > 0
        self._deceleration = float(np.min(puma.ACCELERATION[moved] / np.abs(self._delta[moved])))

    def _slow_down(self) -> None:
        time = min(self._step, self._speed / self._deceleration)
        self._share += (self._speed - self._deceleration * time / 2) * time
        self._speed = max(0.0, self._speed - self._deceleration * time) if time == self._step else 0.0
