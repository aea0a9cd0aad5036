"""The grid target in front of the cameras, and a world that a mirror can look at directly."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pybullet
from numpy.typing import NDArray

from handeye.simulation import objects, rig
from handeye.simulation.camera import Image
from handeye.simulation.scene import WorldState
from handeye.simulation.world import Scene, World

HOME = rig.rig().head.home


@dataclass(frozen=True)
class Direct:
    """A world asked without any bus between."""

    there: World

    def scene(self) -> Scene:
        return self.there.scene()

    def world(self, world_time: float | None = None) -> WorldState:
        return self.there.state(world_time)


class Grid:
    """The grid target alone in a PyBullet client."""

    def __init__(self) -> None:
        self.client: int = pybullet.connect(pybullet.DIRECT)
        self.body = objects.build(self.client, objects.GRID)
        self._corners = objects.grid_points(objects.GRID)

    def close(self) -> None:
        pybullet.disconnect(self.client)

    def pose(self, position: list[float], euler: list[float]) -> NDArray[np.float64]:
        """Puts the grid there; returns its intersections (n, 3) in m, world frame."""
        orientation = pybullet.getQuaternionFromEuler(euler)
        pybullet.resetBasePositionAndOrientation(self.body, position, orientation, physicsClientId=self.client)
        rotation = np.array(pybullet.getMatrixFromQuaternion(orientation)).reshape(3, 3)
        corners: NDArray[np.float64] = self._corners @ rotation.T + np.array(position)
        return corners


def found_corners(image: Image) -> NDArray[np.float64]:
    """The grid's intersections (n, 2) as (row, column), or none when the grid is not found."""
    size = (objects.GRID_INTERSECTIONS, objects.GRID_INTERSECTIONS)
    found, corners = cv2.findChessboardCornersSB(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), size)
    if not found:
        return np.empty((0, 2))
    return np.asarray(corners, dtype=np.float64)[:, 0, ::-1]


def offsets(found: NDArray[np.float64], expected: NDArray[np.float64]) -> NDArray[np.float64]:
    """Found minus nearest expected corner, (n, 2): a square grid looks the same from four sides."""
    distances = np.linalg.norm(found[:, None] - expected[None], axis=2)
    nearest = distances.argmin(axis=1)
    assert len(set(nearest.tolist())) == len(found), "two found corners belong to one"
    result: NDArray[np.float64] = found - expected[nearest]
    return result
