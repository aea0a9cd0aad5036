"""Small motions around a posture: they teach how image and joints change together there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from handeye.rpc.errors import Unreachable
from handeye.simulation import grasping, kinematics

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Scatter:
    """How small motions around a posture are drawn: ± m along the tool's axes x, y, z, and ± rad about each of them.

    `forward` and `backward` bound z, the approach direction, apart. Half of the motions are drawn from the whole
    range, the other half from ever smaller shares of it: the last looks before a goal are the closest ones. With
    `above` the tool centre point never comes lower than in the posture itself: what is held would meet the table.
    """

    count: int
    x: float
    y: float
    backward: float
    forward: float
    angle: float
    above: bool = False

    def draw(self, pose: Array, random: np.random.Generator) -> list[Array]:
        """`count` poses (4, 4) around `pose`, world_from_tool."""
        return [
            self._one(pose, random, 1.0 if number % 2 == 0 else 0.5 ** random.uniform(1, 4))
            for number in range(self.count)
        ]

    def _one(self, pose: Array, random: np.random.Generator, share: float) -> Array:
        offset = random.uniform([-self.x, -self.y, -self.backward], [self.x, self.y, self.forward]) * share
        change = np.eye(4)
        change[:3, :3] = _rotation(random.uniform(-self.angle, self.angle, 3) * share)
        change[:3, 3] = offset
        moved: Array = pose @ change
        if self.above:
            moved[2, 3] = pose[2, 3] + abs(moved[2, 3] - pose[2, 3])
        return moved


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """Places around a posture to which the hand is led, held at each as it would grasp there.

    ± m aside and along the approach over the table: half of the places lie before the posture, at its height; half
    beyond it, where the object stands, and so many m higher.
    """

    count: int
    aside: float
    along: float
    above: float

    def draw(self, joints: Array, random: np.random.Generator) -> list[Array]:
        """Joints (6,), rad, around those of a posture, of places that the arm reaches: `count` of them at most, and up
        and down straight above the posture."""
        before = [self._place(joints, -1.0, random) for _ in range(self.count // 2)]
        beyond = [self._place(joints, 1.0, random) for _ in range(self.count - self.count // 2)]
        above = self._solved(joints, np.zeros(2), self.above)
        return [place for place in (*before, above, *beyond, above) if place is not None]

    def _place(self, joints: Array, sign: float, random: np.random.Generator) -> Array | None:
        off = random.uniform([0.0, -self.aside], [self.along, self.aside]) * (sign, 1.0)
        return self._solved(joints, off, self.above if sign > 0.0 else 0.0)

    def _solved(self, joints: Array, off: Array, higher: float) -> Array | None:
        """So many m (along, aside) over the table, and higher; None where the arm does not reach."""
        pose = kinematics.forward(joints)
        forward = pose[:2, 2] / np.linalg.norm(pose[:2, 2])
        left = np.array([-forward[1], forward[0]])
        try:
            over = pose[:2, 3] + off[0] * forward + off[1] * left
            return grasping.solve(grasping.grasp_pose(over, float(pose[2, 3]) + higher))
        except Unreachable:
            return None


@dataclass(frozen=True, slots=True)
class Clumsiness:
    """How far off a teacher leads the hand to each posture that is to be learned: standard deviations along (m) and
    about (rad) each of the tool's axes."""

    position: float
    angle: float

    def off(self, pose: Array, random: np.random.Generator) -> Array:
        """Where the hand comes, (4, 4), when it should come to `pose`."""
        change = np.eye(4)
        change[:3, :3] = _rotation(random.normal(0.0, self.angle, 3))
        change[:3, 3] = random.normal(0.0, self.position, 3)
        moved: Array = pose @ change
        return moved


STEADY = Clumsiness(0.0, 0.0)
CLUMSY = Clumsiness(0.005, np.radians(2.0))


def _rotation(vector: Array) -> Array:
    """Rotation matrix of a rotation vector (3,) in rad (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Array = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return rotation
