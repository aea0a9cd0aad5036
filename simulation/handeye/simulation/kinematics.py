"""Kinematics of the PUMA 560 with its hand, for *move to point*, the teacher and tests; an acting task never uses it.

Joints are (6,) in rad; poses are 4×4 world_from_tool, in m.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handeye.simulation import gripper, puma

Array = NDArray[np.float64]

_A2, _A3, _D3, _D4 = puma.A[1], puma.A[2], puma.D[2], puma.D[3]
# The forearm is the straight line from elbow to wrist: the elbow's offset a3 leans it against link 3's frame.
_FOREARM = float(np.hypot(_A3, _D4))
_LEAN = float(np.arctan2(_D4, _A3))
_FULL_TURN = 2 * np.pi
_SINGULAR = 1e-9
_HALF_FINGER = gripper.FINGER_WIDTH / 2
_WRIST_RADIUS = 0.055
_ELBOW_RADIUS = 0.11


def frames(joints: Array) -> Array:
    """world_from_frame of DH frames 0..6, (7,4,4)."""
    result = np.empty((7, 4, 4))
    pose = np.eye(4)
    pose[:3, 3] = puma.BASE_POSITION
    result[0] = pose
    for i in range(6):
        pose = pose @ _link(i, float(joints[i]))
        result[i + 1] = pose
    return result


def forward(joints: Array) -> Array:
    """world_from_tool at `joints`."""
    pose: Array = frames(joints)[6]
    pose[:3, 3] += gripper.TOOL_LENGTH * pose[:3, 2]
    return pose


def lowest_point(joints: Array) -> float:
    """Height above the table of the lowest of finger tips, wrist and elbow at `joints`, in m; below zero is in it."""
    chain = frames(joints)
    tool = forward(joints)
    across, along = _HALF_FINGER * tool[2, 0], gripper.TIP * tool[2, 2]
    tips = tool[2, 3] + along - abs(across)
    wrist = chain[4:, 2, 3].min() - _WRIST_RADIUS
    elbow = chain[2:4, 2, 3].min() - _ELBOW_RADIUS
    return float(min(tips, wrist, elbow))


def inverse(world_from_tool: Array) -> Array:
    """All joint positions within the limits that reach the pose, (n,6) with n ≤ 8.

    Closed form for a spherical wrist (J. J. Craig, *Introduction to Robotics*, 4.7): left or right shoulder × elbow up
    or down × wrist flipped or not. Empty when the pose is out of reach or every branch breaks a limit. Where the wrist
    is straight (joint 5 at zero) only θ4 + θ6 matters, and θ4 is 0 or π. Of equivalent angles a full turn apart the one
    nearest to zero that the limits allow is given.
    """
    solutions: list[Array] = []
    rotation = world_from_tool[:3, :3]
    wrist = world_from_tool[:3, 3] - gripper.TOOL_LENGTH * rotation[:, 2] - puma.BASE_POSITION
    for arm in _arm_branches(wrist):
        upper = _rotation_to_wrist(arm)
        solutions += [np.concatenate([arm, angles]) for angles in _wrist_branches(upper.T @ rotation)]
    wrapped = (_within_limits(solution, np.zeros(6)) for solution in solutions)
    return np.array([solution for solution in wrapped if solution is not None]).reshape(-1, 6)


def nearest(solutions: Array, joints: Array) -> Array:
    """Of `solutions` (n,6), n ≥ 1, the one least far from `joints`, counted by the slowest joint's time.

    Joints that may turn more than once take the turn nearest to `joints`.
    """
    turned = [_within_limits(solution, joints) for solution in solutions]
    candidates = np.array([solution for solution in turned if solution is not None])
    if not len(candidates):
        raise ValueError("no solution lies within the joint limits")
    times = np.max(np.abs(candidates - joints) / puma.SPEED, axis=1)
    best: Array = candidates[int(np.argmin(times))]
    return best


def _link(i: int, angle: float) -> Array:
    """DH frame i from frame i+1 (counting from zero): Rz(θ) Tz(d) Tx(a) Rx(alpha)."""
    c, s = np.cos(angle), np.sin(angle)
    ca, sa = np.cos(puma.ALPHA[i]), np.sin(puma.ALPHA[i])
    a, d = puma.A[i], puma.D[i]
    return np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0.0, sa, ca, d], [0.0, 0.0, 0.0, 1.0]])


def _arm_branches(wrist: Array) -> list[Array]:
    """θ1..θ3 that bring the wrist's centre to `wrist` (3,), m from the base: up to four."""
    x, y, z = wrist
    radius = np.hypot(x, y)
    if radius < _D3:
        return []
    # The arm's plane passes the waist's axis at the distance d3: x·sin θ1 − y·cos θ1 = d3.
    offset = np.arcsin(_D3 / radius)
    azimuth = np.arctan2(y, x)
    branches = []
    for waist in (azimuth + offset, azimuth + np.pi - offset):
        reach = x * np.cos(waist) + y * np.sin(waist)
        cosine = (reach**2 + z**2 - _A2**2 - _FOREARM**2) / (2 * _A2 * _FOREARM)
        if abs(cosine) > 1.0:
            continue
        for bend in (-np.arccos(cosine), np.arccos(cosine)):
            behind = np.arctan2(_FOREARM * np.sin(bend), _A2 + _FOREARM * np.cos(bend))
            branches.append(np.array([waist, np.arctan2(z, reach) - behind, bend - _LEAN]))
    return branches


def _rotation_to_wrist(arm: Array) -> Array:
    pose = np.eye(4)
    for i in range(3):
        pose = pose @ _link(i, float(arm[i]))
    return pose[:3, :3]


def _wrist_branches(rotation: Array) -> list[Array]:
    """θ4..θ6 of the wrist's rotation Rz(θ4)·Ry(−θ5)·Rz(θ6): two."""
    sine = float(np.hypot(rotation[0, 2], rotation[1, 2]))
    if sine < _SINGULAR:
        # θ5 is 0 (π is beyond its limits): only the sum of θ4 and θ6 is given.
        total = np.arctan2(rotation[1, 0], rotation[0, 0])
        return [np.array([0.0, 0.0, total]), np.array([np.pi, 0.0, total - np.pi])]
    branches = []
    for sign in (1.0, -1.0):
        bend = -np.arctan2(sign * sine, rotation[2, 2])
        roll = np.arctan2(sign * rotation[1, 2], sign * rotation[0, 2])
        flange = np.arctan2(sign * rotation[2, 1], -sign * rotation[2, 0])
        branches.append(np.array([roll, bend, flange]))
    return branches


def _within_limits(joints: Array, near: Array) -> Array | None:
    """The equivalent angles, full turns apart, nearest to `near` and within the limits; None when there are none."""
    first = near + (joints - near + np.pi) % _FULL_TURN - np.pi
    turns = first + _FULL_TURN * np.array([[0.0], [-1.0], [1.0]])
    allowed = (turns >= puma.LOWER) & (turns <= puma.UPPER)
    if not allowed.any(axis=0).all():
        return None
    distance = np.where(allowed, np.abs(turns - near), np.inf)
    chosen: Array = np.take_along_axis(turns, np.argmin(distance, axis=0)[None], axis=0)[0]
    return chosen
