"""Where something is that moves, from looks at it that come late and at uneven times."""

from __future__ import annotations

import numpy as np

from handeye.camera_bridge.driver import Course
from handeye.modules.spaces import Floats, HeadAngles

_SPREAD = 0.2  # rad/s: how fast a thing that was seen once may be moving


class Tracker:
    """A Kalman filter for the direction in which something is, pan and tilt each with a rate that stays as it is.

    A direction is that of the head when the thing is in the middle of the left picture: the head's own turns are not
    in it, so a thing at rest has one that stands still, wherever it was looked at from.
    """

    def __init__(self, noise: float, agility: float) -> None:
        """`noise`: standard deviation of a direction, in rad; `agility`: variance by which rates change, in rad²/s³."""
        self._noise = noise
        self._agility = agility
        self._state = np.zeros((2, 2))
        """Rows: directions in rad, rates in rad/s; columns: pan, tilt."""
        self._covariance = np.zeros((2, 2))
        self._time: float | None = None

    def see(self, direction: HeadAngles, world_time: float) -> None:
        """It was seen in a direction at a world time in s, later than the one before."""
        seen = direction.array()
        if self._time is None:
            self._state = np.vstack([seen, np.zeros(2)])
            self._covariance = np.diag([self._noise**2, _SPREAD**2])
        else:
            self._predict(world_time - self._time)
            gain: Floats = self._covariance[:, 0] / (self._covariance[0, 0] + self._noise**2)
            self._state = self._state + np.outer(gain, seen - self._state[0])
            self._covariance = self._covariance - np.outer(gain, self._covariance[0])
        self._time = world_time

    @property
    def course(self) -> Course:
        """Where it was, and how it moves, when it was seen last; `ValueError` when it never was."""
        if self._time is None:
            raise ValueError("nothing has been seen yet")
        (pan, tilt), (pan_rate, tilt_rate) = self._state.tolist()
        return Course(pan, tilt, pan_rate, tilt_rate, self._time)

    def _predict(self, elapsed: float) -> None:
        step = np.array([[1.0, elapsed], [0.0, 1.0]])
        wander = np.array([[elapsed**3 / 3.0, elapsed**2 / 2.0], [elapsed**2 / 2.0, elapsed]])
        self._state = step @ self._state
        self._covariance = step @ self._covariance @ step.T + self._agility * wander
