"""What is otherwise with the rig in one world than it was when the robot was taught. The acting side hears nothing of
it: only its eyes and encoders can tell."""

from __future__ import annotations

import math
from dataclasses import dataclass

from handeye.simulation import gripper

_LARGEST_OFFSET = math.radians(10.0)
_LEAST_OPENING = 0.01  # m
_LARGEST_PUSH = 0.2  # m
_LONGEST_SLIP = 5.0  # s


@dataclass(frozen=True, slots=True)
class Conditions:
    """Conditions of one world, from its reset to the next one."""

    opening: float = gripper.RANGE
    """How far the gripper opens, in m."""
    joint_offsets: tuple[float, ...] = (0.0,) * 6
    """How much more each joint's encoder reads than the joint has turned, in rad."""
    head_bump: tuple[float, float] = (0.0, 0.0)
    """How far the head is turned beyond the (pan, tilt) that it reports, in rad."""

    push: tuple[float, float] = (0.0, 0.0)
    """About how far, along x and y of the world frame, in m, an object is pushed once the arm rests before it."""
    slip: float = 0.0
    """For how long, in s, the fingers have no grip once they have raised an object a little."""

    def __post_init__(self) -> None:
        if not _LEAST_OPENING <= self.opening <= gripper.RANGE:
            raise ValueError(f"opening must lie in {_LEAST_OPENING}..{gripper.RANGE} m, got {self.opening}")
        if len(self.joint_offsets) != 6 or len(self.head_bump) != 2:
            raise ValueError("joint_offsets must be six angles and head_bump two")
        for angle in (*self.joint_offsets, *self.head_bump):
            if not abs(angle) <= _LARGEST_OFFSET:  # not true of nan
                raise ValueError(f"offsets and bumps must be at most {_LARGEST_OFFSET:.3f} rad, got {angle}")
        if len(self.push) != 2 or not all(abs(way) <= _LARGEST_PUSH for way in self.push):
            raise ValueError(f"push must be two ways of at most {_LARGEST_PUSH} m, got {self.push}")
        if not 0.0 <= self.slip <= _LONGEST_SLIP:
            raise ValueError(f"slip must lie in 0..{_LONGEST_SLIP} s, got {self.slip}")


ORDINARY = Conditions()
"""As it was taught."""
