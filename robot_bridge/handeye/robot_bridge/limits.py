"""What is wrong with a command, said before anything moves."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from handeye.robot_bridge.driver import Joints, Pace, RobotDescription
from handeye.rpc.errors import InvalidArgument, OutOfLimits, Stopped

DEFAULT_PACE = Pace()
"""Half of the limits."""
READING_ERROR = 1e-3
"""A joint that stands at its limit may read beyond it by so much, in rad, for its encoder has steps."""
LEAST_PACE = 1e-3
"""Smallest share of a limit: slower motions would not end in any useful time."""
MAX_ADVANCE = 60.0
"""Longest world time in s that one `advance` may let pass."""


def check_vector(name: str, values: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """`values` as a float64 array of shape (size,); `InvalidArgument` when it is none or not finite."""
    try:
        vector = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidArgument(f"{name} must be {size} numbers, got {values!r}", detail=name) from error
    if vector.shape != (size,):
        raise InvalidArgument(f"{name} must have shape ({size},), got {vector.shape}", detail=name)
    if not np.isfinite(vector).all():
        raise InvalidArgument(f"{name} must be finite, got {vector.tolist()}", detail=name)
    return vector


def check_joints(description: RobotDescription, target: Joints, tolerance: float = 0.0) -> None:
    """`OutOfLimits` when a joint's target lies outside its limits (all in rad); the message names every such joint."""
    outside = np.flatnonzero((target < description.lower - tolerance) | (target > description.upper + tolerance))
    if outside.size:
        wrong = "; ".join(
            f"{description.joint_names[i]} would be {target[i]:.4f} rad, "
            f"its limits are [{description.lower[i]:.4f}, {description.upper[i]:.4f}]"
            for i in outside
        )
        raise OutOfLimits(f"joint limits: {wrong}", detail=description.joint_names[outside[0]])


def check_opening(description: RobotDescription, opening: float) -> None:
    """`InvalidArgument` unless `opening` (m) lies within the gripper's range."""
    if not 0.0 <= opening <= description.gripper_range:
        raise InvalidArgument(
            f"an opening must lie in [0, {description.gripper_range:g}] m, got {opening}", detail="least_opening"
        )


def check_pace(pace: Pace) -> None:
    """`InvalidArgument` unless both shares lie in [0.001, 1]."""
    for name, share in (("speed", pace.speed), ("acceleration", pace.acceleration)):
        if not LEAST_PACE <= share <= 1.0:
            raise InvalidArgument(f"pace.{name} must be a share in [{LEAST_PACE:g}, 1], got {share}", detail=name)


def check_duration(duration: float) -> None:
    """`InvalidArgument` unless `duration` (s) lies in [0, 60]."""
    if not (math.isfinite(duration) and 0.0 <= duration <= MAX_ADVANCE):
        raise InvalidArgument(f"duration must lie in [0, {MAX_ADVANCE:g}] s, got {duration}", detail="duration")


def stopped(reason: str) -> Stopped:
    """What a command is refused with while the software stop is latched for `reason`; says how to clear it."""
    return Stopped(f"the robot is stopped ({reason}): reset it first (handeye reset, or POST /v1/robot/reset)")
