"""Where the arm is to go, from several answers that each say so with some noise."""

from __future__ import annotations

import numpy as np

from handeye.robot_bridge.driver import Joints

_EXACT = 1e-6  # rad: no answer is taken for more exact
_SHORTEST = 1 / 3
"""No answer is taken to ask for less than this share of what it should."""
_NEAR = 5.0  # noises: further away an answer may ask for something new instead, because the object was moved


class Goals:
    """The newest answers of one subtask that differ by their noise only.

    An answer is the less exact the further it goes, beyond a noise that they all have: so much less it weighs.

    When an answer was followed and the next one asks for much of it again, answers are too short there, as where the
    arm is stretched out and each of them brings the hand hardly nearer. Then it goes on by so much more.
    """

    def __init__(self, noise: float) -> None:
        """`noise`: answers with a joint elsewhere by more than this, in rad, do not mean the same goal."""
        self._noise = noise
        self.forget()

    def forget(self) -> None:
        """What comes now is another subtask's."""
        self._answers: list[Joints] = []
        self._weights: list[float] = []
        self._before: tuple[Joints, Joints] | None = None
        self._share = 1.0
        """Which share of what they should the answers ask for."""

    def mean(self, joints: Joints, turn: Joints) -> Joints:
        """The goal (joints,), rad, by all answers with this one: from `joints` on by `turn`."""
        answer = joints + turn / self._share
        if self._answers and np.max(np.abs(answer - self._mean())) > self._noise:
            self._share = self._measured(joints, turn) if np.max(np.abs(turn)) < _NEAR * self._noise else 1.0
            answer = joints + turn / self._share
            self._answers, self._weights = [], []
        self._before = joints, turn
        self._answers.append(answer)
        self._weights.append(max(self._noise + float(np.max(np.abs(turn))), _EXACT) ** -2)
        return self._mean()

    def _measured(self, joints: Joints, turn: Joints) -> float:
        """The share: as much less is asked for now as the way since then was long."""
        if self._before is None:
            return 1.0
        there, asked = self._before
        way = joints - there
        gone = float(way @ way)
        return float(np.clip((asked - turn) @ way / gone, _SHORTEST, 1.0)) if gone else 1.0

    def _mean(self) -> Joints:
        mean: Joints = np.average(self._answers, axis=0, weights=self._weights)
        return mean
