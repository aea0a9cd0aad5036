"""When a motion is over: the arm has been led to its end and stands still."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from handeye.simulation.scene import STEP

_STILL_SPEED = 2e-3  # rad/s, on average over so many steps
_STILL_STEPS = 6
_TWITCH_SPEED = 1.5e-2  # rad/s: what is gripped may make joints twitch, by some 0.1 mm at the hand, for ever
_TWITCHES = 72  # steps after which that counts as still
_SETTLE_LIMIT = 480  # steps after which a motion is over, though something keeps the arm from standing still


class Stillness:
    """Counts the steps for which the arm has stood still, and so knows whether a motion is under way."""

    def __init__(self) -> None:
        self._still = _STILL_STEPS
        self._joints: deque[NDArray[np.float64]] = deque(maxlen=_STILL_STEPS + 1)
        self._unled = 0
        self._busy = False

    @property
    def busy(self) -> bool:
        """A motion is under way or has not settled yet."""
        return self._busy

    def begin(self) -> None:
        """A motion begins."""
        self._busy, self._still, self._unled = True, 0, 0

    def observe(self, joints: NDArray[np.float64], *, led: bool) -> None:
        """Takes note of a physics step: where the joints (6,) are, in rad, and whether a controller leads the arm."""
        self._joints.append(joints)
        passed = max(len(self._joints) - 1, 1) * STEP
        speed = float(np.max(np.abs(joints - self._joints[0]))) / passed
        self._unled = 0 if led else self._unled + 1
        most = _STILL_SPEED if self._unled < _TWITCHES else _TWITCH_SPEED
        self._still = 0 if led or speed > most else self._still + 1
        if self._still >= _STILL_STEPS or self._unled >= _SETTLE_LIMIT:
            self._busy = False

    def since(self, step: int) -> float:
        """World time since when the arm stands still, s, at step `step`; infinite while it moves."""
        return max(0, step - self._still + 1) * STEP if self._still >= _STILL_STEPS else math.inf
