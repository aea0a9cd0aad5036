"""What goes wrong in a world while the hand is at work, at moments that the world itself tells: the same every time."""

from __future__ import annotations

import numpy as np
import pybullet
from numpy.typing import NDArray

from handeye.simulation import gripper
from handeye.simulation.conditions import Conditions
from handeye.simulation.scene import FINGER_1, FINGER_2, STEP, Stage

Array = NDArray[np.float64]

_NEAR = 0.13  # m between tool centre point and object, over the table: the hand is before it
_PUSHING = 0.25  # s
_RAISED = 0.015  # m


class Mishaps:
    """A push, once the arm rests before an object, and a slip, once it has raised one: each once."""

    def __init__(self, stage: Stage, conditions: Conditions) -> None:
        self._stage = stage
        self._push = np.array([*conditions.push, 0.0])
        self._push_left = round(_PUSHING / STEP) if self._push.any() else 0
        self._pushed: int | None = None
        self._slip = round(conditions.slip / STEP)
        self._slip_left = 0
        self._stood: dict[int, float] = {}
        """How high each body stood when it was seen first, in m."""

    def before_step(self, tool: Array, *, moving: bool) -> None:
        """What goes wrong in the coming physics step; `tool` (3,) is the tool centre point, in m, world frame."""
        for body in self._stage.objects.values():
            position = np.array(pybullet.getBasePositionAndOrientation(body, physicsClientId=self._stage.client)[0])
            stood = self._stood.setdefault(body, float(position[2]))
            if self._pushed is None and not moving and np.hypot(*(position - tool)[:2]) < _NEAR:
                self._pushed = body
            if self._slip and position[2] > stood + _RAISED:
                self._slip, self._slip_left = 0, self._slip
                self._grip(0.0)
        if self._push_left and self._pushed in self._stage.objects.values():
            self._go_on_pushing(self._pushed)
        if self._slip_left:
            self._slip_left -= 1
            if not self._slip_left:
                self._grip(gripper.PAD_FRICTION)

    def _go_on_pushing(self, body: int | None) -> None:
        self._push_left -= 1
        speed = self._push / _PUSHING if self._push_left else np.zeros(3)
        # A body at rest falls asleep, and asleep it does not move.
        pybullet.changeDynamics(
            body, -1, activationState=pybullet.ACTIVATION_STATE_WAKE_UP, physicsClientId=self._stage.client
        )
        pybullet.resetBaseVelocity(body, speed.tolist(), [0.0] * 3, physicsClientId=self._stage.client)

    def _grip(self, friction: float) -> None:
        for finger in (FINGER_1, FINGER_2):
            pybullet.changeDynamics(
                self._stage.robot, finger, lateralFriction=friction, physicsClientId=self._stage.client
            )
