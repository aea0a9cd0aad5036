"""Where the hand has to be to grasp a cup from the side, and the joints that bring it there on one smooth branch.

For the teacher and for tests: an acting task may not use it. The tool is pitched down by `PITCH` in the arm's own
vertical plane, so that joints 4 and 6 stay at zero and joints 1, 2, 3 and 5 do all: right shoulder, elbow up.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from handeye.rpc.errors import Unreachable
from handeye.simulation import kinematics, puma

Array = NDArray[np.float64]

PITCH = math.radians(20.0)
"""How far the approach direction points below the horizontal, in rad."""
GRASP_HEIGHT = 0.0475
"""Height of the tool centre point at the grasp: half a cup's, in m."""
APPROACH_DISTANCE = 0.09
"""How far before the grasp the approach pose lies, against the approach direction, in m."""
LIFT_HEIGHT = 0.15
"""How far the lift raises the cup, in m."""
PARK_POINT: Array = np.array([0.35, 0.0, 0.20])
"""The tool centre point at the park position, in m, world frame."""


def grasp_pose(xy: Array, height: float = GRASP_HEIGHT) -> Array:
    """world_from_tool, 4×4, with the tool centre point at (x, y, height), m, and the tool in the arm's plane."""
    point = np.array([xy[0], xy[1], height])
    azimuth = _waist(point)
    forward = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    left = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    down = np.array([0.0, 0.0, -1.0])
    approach = math.cos(PITCH) * forward + math.sin(PITCH) * down
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = np.cross(left, approach), left, approach, point
    return pose


def approach_pose(xy: Array, height: float = GRASP_HEIGHT, distance: float = APPROACH_DISTANCE) -> Array:
    """world_from_tool, 4×4, `distance` before the grasp pose along the approach direction."""
    pose = grasp_pose(xy, height)
    pose[:3, 3] -= distance * pose[:3, 2]
    return pose


def lift_pose(xy: Array, height: float = GRASP_HEIGHT, lift: float = LIFT_HEIGHT) -> Array:
    """world_from_tool, 4×4, `lift` above the grasp pose."""
    pose = grasp_pose(xy, height)
    pose[2, 3] += lift
    return pose


def solve(pose: Array) -> Array:
    """The joints (6,), rad, of a pose whose tool lies in the arm's plane: elbow up, joints 4 and 6 at zero.

    Raises:
        Unreachable: the pose is out of reach or beyond a joint limit on this branch.
    """
    for joints in kinematics.inverse(pose):
        elbow_up = joints[2] < -math.pi / 2
        if elbow_up and abs(joints[0]) < math.pi / 2 and np.all(np.abs(joints[[3, 5]]) < 1e-6):
            branch: Array = joints.copy()
            branch[[3, 5]] = 0.0
            return branch
    x, y, z = pose[:3, 3]
    raise Unreachable(f"the hand cannot be brought to ({x:.3f}, {y:.3f}, {z:.3f}) m on the grasping branch")


def solve_chain(xy: Array, height: float = GRASP_HEIGHT) -> dict[str, Array]:
    """The joints of "approach", "grasp" and "lift" for a cup at `xy` (2,), m, all on one branch.

    No via point is needed: straight joint-space motions from park to approach to grasp come from behind the cup.
    """
    poses = {
        "approach": approach_pose(xy, height),
        "grasp": grasp_pose(xy, height),
        "lift": lift_pose(xy, height),
    }
    return {name: solve(pose) for name, pose in poses.items()}


def _waist(point: Array) -> float:
    """θ1 that brings `point` (3,) into the arm's plane, in rad."""
    x, y = (point - puma.BASE_POSITION)[:2]
    return math.atan2(y, x) + math.asin(puma.D[2] / math.hypot(x, y))


PARK: Array = solve(grasp_pose(PARK_POINT[:2], float(PARK_POINT[2])))
"""The park position (6,), rad: hand back and up, its marker in view of both cameras."""
PARK.setflags(write=False)
