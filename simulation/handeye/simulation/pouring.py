"""Where the hand has to be to pour from a cup into a jar beside it, and to set cups down beside or on things.

For the teacher and for tests, as `handeye.simulation.grasping`. The cup comes from the robot's right (−y), and is
turned about the approach direction, mostly by joint 6, so that its lip stays over the jar.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from handeye.rpc.errors import Unreachable
from handeye.simulation import grasping, kinematics
from handeye.simulation.objects import ObjectSpec

Array = NDArray[np.float64]

TURNS = tuple(np.radians([60.0, 90.0, 110.0, 130.0]).tolist())
"""How far the cup is turned at the way-points of the pour, in rad; the last one empties it."""
SHORT = 0.020
"""The lip is so far on this side of the jar's axis, in m."""
OVER = 0.032
"""And at least so far above its rim, in m: the finger under the cup needs the room."""
CLEARANCE = 0.05
"""Between the jar's rim and the bottom of the upright cup before it is poured, in m."""
BESIDE = 0.16
"""The empty cup is set down so far from the jar's axis, in m."""


def pouring_chain(jar: Array, jar_spec: ObjectSpec, cup: ObjectSpec, near: Array) -> dict[str, list[Array]]:
    """The joints of "above", "start" (one each), "turned" (each of `TURNS`), and of "beside" the jar at (2,), m.

    Each is the nearest to the one before, the first to `near` (6,), rad. `Unreachable` says where the hand cannot be.
    """
    first = _turned(jar, jar_spec, cup, TURNS[1])
    upright = grasping.grasp_pose(first[:2, 3], jar_spec.height + CLEARANCE + cup.height / 2)
    above, beside = upright.copy(), grasping.grasp_pose(_beside(jar), cup.height / 2)
    above[2, 3] += CLEARANCE
    found: dict[str, list[Array]] = {}
    for name, poses in (
        ("above", [above]),
        ("start", [upright]),
        ("turned", [_turned(jar, jar_spec, cup, turn) for turn in TURNS]),
    ):
        found[name] = []
        for pose in poses:
            near = solve(pose, near)
            found[name].append(near)
    return found | {"beside": [solve(beside, found["start"][0])]}


def standing_on(place: Array, height: float, cup: ObjectSpec, near: Array) -> Array:
    """The joints (6,), rad, nearest to `near`, with a grasped cup's bottom `height` above the table at (2,), m."""
    return solve(grasping.grasp_pose(place, height + cup.height / 2), near)


def solve(pose: Array, near: Array) -> Array:
    """The joints (6,), rad, that reach a pose (4, 4), nearest to `near`; `Unreachable` when there are none."""
    solutions = kinematics.inverse(pose)
    if not len(solutions):
        raise Unreachable(f"the hand cannot be brought to {np.round(pose[:3, 3], 3).tolist()} m, turned as asked")
    return kinematics.nearest(solutions, near)


def _turned(jar: Array, jar_spec: ObjectSpec, cup: ObjectSpec, turn: float) -> Array:
    """world_from_tool, 4×4, with the cup turned by `turn`, rad, its lip over the jar at (2,), m."""
    pose = grasping.grasp_pose(jar, jar_spec.height)
    for _ in range(3):  # how the hand points depends on where it is
        left, upright = pose[:3, 1].copy(), pose[:3, :3].T @ [0.0, 0.0, 1.0]
        pose[:3, :3] = pose[:3, :3] @ _about_approach(-turn)
        axis = pose[:3, :3] @ upright
        down = -np.array([0.0, 0.0, 1.0]) + axis * axis[2]
        lip = axis * cup.height / 2 + cup.radius * down / np.linalg.norm(down)
        # The less it is turned, the higher it has to be: its wall must pass the jar's rim.
        over = OVER + max(0.0, (jar_spec.radius - SHORT) / math.tan(turn))
        point = np.array([jar[0], jar[1], jar_spec.height + over]) - SHORT * left - lip
        turned = pose[:3, :3].copy()
        pose = grasping.grasp_pose(point[:2], point[2])
    pose[:3, :3] = turned
    return pose


def _beside(jar: Array) -> Array:
    """Where the empty cup is set down, (2,) in m."""
    place: Array = jar - np.array([0.0, BESIDE])
    return place


def _about_approach(angle: float) -> Array:
    """Rotation (3, 3) about the tool's z."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
