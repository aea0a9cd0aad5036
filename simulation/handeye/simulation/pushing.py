"""An object that somebody pushes along the table, as with a stick: off gently, evenly along a path, gently to rest."""

from __future__ import annotations

import math

import numpy as np
import pybullet
from numpy.typing import NDArray

from handeye.rpc.errors import InvalidArgument
from handeye.simulation import placement
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.pose import Pose
from handeye.simulation.scene import STEP, Stage

Array = NDArray[np.float64]

ACCELERATION = 0.4
"""How fast a push begins and ends, in m/s²."""
FASTEST = 0.5
"""m/s."""
LONGEST = 10.0
"""m that one push may lead."""

_EVERY = 0.02  # m along the path between two places that must be free


class Push:
    """One push of an object from where it is. `drive` leads it before each physics step."""

    def __init__(self, stage: Stage, spec: ObjectSpec, path: Array, speed: float) -> None:
        """`path`: (n, 2), m, world frame, where the object's axis is led one after the other; `speed` in m/s.

        `InvalidArgument` when these are no such numbers, or the path leaves the table, or leads through something.
        """
        if path.ndim != 2 or path.shape[1:] != (2,) or not len(path) or not np.isfinite(path).all():
            raise InvalidArgument(f"path of {spec.name!r} must be finite places (x, y), got {path.tolist()}", "path")
        if not 0.0 < speed <= FASTEST:  # not true of nan
            raise InvalidArgument(
                f"{spec.name!r} is pushed at more than 0, at most {FASTEST} m/s, got {speed}", "speed"
            )
        self._stage = stage
        self._body = stage.objects[spec.name]
        position, orientation = pybullet.getBasePositionAndOrientation(self._body, physicsClientId=stage.client)
        self._height: float = position[2]
        self._orientation: tuple[float, ...] = orientation
        self._corners = np.vstack([position[:2], path])
        lengths = np.linalg.norm(np.diff(self._corners, axis=0), axis=1)
        self._lengths: Array = np.concatenate([[0.0], np.cumsum(lengths)])
        if (total := float(self._lengths[-1])) > LONGEST:
            raise InvalidArgument(f"{spec.name!r} is pushed {LONGEST:g} m at most, got {total:.3g} m", detail="path")
        for place in path:
            placement.require_on_table(spec, place, 0.0)
        way = np.linspace(0.0, total, 1 + math.ceil(total / _EVERY))
        placement.require_free(stage, spec.name, [self._pose(length) for length in way])
        self._speed = speed
        self._step = 0

    @property
    def duration(self) -> float:
        """How long it takes in all, in s of world time."""
        total, speeding_up = float(self._lengths[-1]), self._speed / ACCELERATION
        if total < self._speed * speeding_up:
            return 2.0 * math.sqrt(total / ACCELERATION)
        return total / self._speed + speeding_up

    def drive(self) -> bool:
        """Puts the object where it is on its way by now; False once it has come to the end, or the robot touches it."""
        client = self._stage.client
        if pybullet.getContactPoints(self._stage.robot, self._body, physicsClientId=client):
            return False
        here, there = (self._pose(self._travelled((self._step + more) * STEP)) for more in (0, 1))
        self._step += 1
        goes_on = self._step * STEP < self.duration
        pose = here if goes_on else there
        velocity = (there.position - here.position) / STEP if goes_on else np.zeros(3)
        pybullet.resetBasePositionAndOrientation(
            self._body, pose.position.tolist(), pose.orientation.tolist(), physicsClientId=client
        )
        pybullet.resetBaseVelocity(self._body, velocity.tolist(), [0.0, 0.0, 0.0], physicsClientId=client)
        return goes_on

    def _travelled(self, elapsed: float) -> float:
        """How much of the path is behind, in m."""
        left = self.duration - elapsed
        if left <= 0.0:
            return float(self._lengths[-1])
        speeding_up = min(self._speed / ACCELERATION, self.duration / 2.0)
        if elapsed < speeding_up:
            return 0.5 * ACCELERATION * elapsed**2
        if left < speeding_up:
            return float(self._lengths[-1]) - 0.5 * ACCELERATION * left**2
        return ACCELERATION * speeding_up * (elapsed - speeding_up / 2.0)

    def _pose(self, travelled: float) -> Pose:
        x, y = (np.interp(travelled, self._lengths, self._corners[:, axis]) for axis in (0, 1))
        return Pose(np.array([x, y, self._height]), np.array(self._orientation))
