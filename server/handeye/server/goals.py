"""Where the arm is to go, from several answers that each say so with some noise."""

from __future__ import annotations

import numpy as np

from handeye.robot_bridge.driver import Joints

_EXACT = 1e-6  # rad: no answer is taken for more exact


class Goals:
    """The newest answers of one subtask that differ by their noise only.

    An answer is the less exact the further it goes, beyond a noise that they all have: so much less it weighs.
    """

    def __init__(self, noise: float) -> None:
        """`noise`: answers with a joint elsewhere by more than this, in rad, do not mean the same goal."""
        self._noise = noise
        self.forget()

    def forget(self) -> None:
        """What comes now is another subtask's."""
        self._answers: list[Joints] = []
        self._weights: list[float] = []

    def mean(self, joints: Joints, turn: Joints) -> Joints:
        """The goal (joints,), rad, by all answers with this one: from `joints` on by `turn`."""
        answer = joints + turn
        if self._answers and np.max(np.abs(answer - self._mean())) > self._noise:
            self.forget()
        self._answers.append(answer)
        self._weights.append(max(self._noise + float(np.max(np.abs(turn))), _EXACT) ** -2)
        return self._mean()

    def _mean(self) -> Joints:
        mean: Joints = np.average(self._answers, axis=0, weights=self._weights)
        return mean
