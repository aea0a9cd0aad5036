"""The referee: which subtasks of a trial passed, from the lab's truth. No task ever sees this.

The thesis marked its trials by hand (Table 4.1); here is the same judgement in numbers. All lengths in m and times
in s of world time unless a name says mm. The tool frame has its origin between the finger pads, z along the approach
and y along the travel of the fingers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from handeye.simulation.scene import WorldState

SUBTASKS = ("approach", "grasp", "lift")
"""The subtasks of Table 4.1's task, in order."""

MOVED_LIMIT = 0.010
"""An approach that moves the cup further than this has failed."""
TILT_LIMIT = math.radians(10.0)
"""A cup that leans more than this does not stand upright."""
REACH_AHEAD = 0.20
"""The cup is before the hand when its centre is at most so far ahead of the tool centre point."""
EDGE = 0.010
"""The pads must meet the wall at least so far from the cup's bottom and rim."""
LIFT_HEIGHT = 0.10
"""A lifted cup's lowest point is at least so far above the table."""
LIFT_TIME = 2.0
"""So long, at the end of the trial, a lifted cup stays up."""
CLOSING = 0.001
"""The gripper has begun to close when the pads are so much nearer than at the start."""


@dataclass(frozen=True, slots=True)
class CupSize:
    """Outer radius at half height, and height."""

    radius: float
    height: float


@dataclass(frozen=True, slots=True)
class Track:
    """What happened in a trial: n moments of truth, oldest first, the first one before the hand has moved.

    `time` (n,); `cup` (n, 3) centre of the cup, world frame; `cup_axis` (n, 3) its axis, from bottom to rim, unit
    length; `tool` (n, 4, 4) world_from_tool; `opening` (n,) distance between the pads; `touches` (n, 2) which finger
    touches the cup.
    """

    time: NDArray[np.float64]
    cup: NDArray[np.float64]
    cup_axis: NDArray[np.float64]
    tool: NDArray[np.float64]
    opening: NDArray[np.float64]
    touches: NDArray[np.bool_]

    @classmethod
    def of(cls, states: Sequence[WorldState], name: str) -> Track:
        """The track of the object `name` in the history `states`; `KeyError` when it is not in all of them."""
        cups = [state.object(name) for state in states]
        return cls(
            time=np.array([state.world_time for state in states]),
            cup=np.array([cup.pose.position for cup in cups]),
            cup_axis=np.array([cup.pose.matrix()[:3, 2] for cup in cups]),
            tool=np.array([state.tool.matrix() for state in states]),
            opening=np.array([state.fingers.sum() for state in states]),
            touches=np.array([[cup.touches_finger_1, cup.touches_finger_2] for cup in cups]),
        )

    def at(self, time: float) -> int:
        """Index of the last moment that is not after `time` (the first one if all are)."""
        return max(0, int(np.searchsorted(self.time, time + 1e-9, side="right")) - 1)

    def tilt(self, index: int) -> float:
        """Angle between the cup's axis and the vertical, in rad."""
        return math.acos(float(np.clip(self.cup_axis[index, 2], -1.0, 1.0)))

    def displacement(self) -> NDArray[np.float64]:
        """Horizontal distance of the cup from where it was placed, shape (n,)."""
        x, y = (self.cup[:, :2] - self.cup[0, :2]).T
        moved: NDArray[np.float64] = np.hypot(x, y)
        return moved

    def closing(self) -> int | None:
        """Index of the last moment before the gripper first begins to close; None if it never does."""
        closing = np.flatnonzero(self.opening < self.opening[0] - CLOSING)
        return max(0, int(closing[0]) - 1) if len(closing) else None


@dataclass(frozen=True, slots=True)
class Score:
    """The referee's judgement on one trial.

    `miss_mm` is the distance (3-D) of the tool centre point from the cup's centre at the moment before the gripper
    begins to close; of a trial in which it never closes, at the trial's end. `pushed_mm` is the greatest horizontal
    distance from its placement that the cup had until the closing was complete, so it includes what the closing
    fingers themselves push; of a trial without closing, until its end.
    """

    passed: Mapping[str, bool]
    miss_mm: float
    pushed_mm: float


def score(track: Track, cup: CupSize, ended: Mapping[str, float]) -> Score:
    """Judges a trial. `ended` holds the world time at which each subtask that was completed ended.

    * *approach* passed: when it ended, the cup had moved less than 10 mm, stood upright (< 10°), and the grasp was
      possible by moving straight ahead: see `grasp_possible`.
    * *grasp* passed: when it ended, that is after closing, both fingers touched the cup and it stood upright.
    * *lift* passed: the cup's lowest point was at least 10 cm above the table during the last 2 s of the trial, and
      the trial was not shorter than that after its grasp.

    A subtask that was not completed has not passed.
    """
    closing = track.closing()
    last = len(track.time) - 1
    judged_at = last if closing is None else closing
    complete = track.at(ended["grasp"]) if "grasp" in ended else last
    return Score(
        passed={
            "approach": "approach" in ended and _approached(track, cup, track.at(ended["approach"])),
            "grasp": "grasp" in ended and bool(track.touches[complete].all()) and track.tilt(complete) < TILT_LIMIT,
            "lift": "lift" in ended and _lifted(track, cup),
        },
        miss_mm=1000.0 * float(np.linalg.norm(track.cup[judged_at] - track.tool[judged_at, :3, 3])),
        pushed_mm=1000.0 * float(track.displacement()[: complete + 1].max()),
    )


def grasp_possible(track: Track, cup: CupSize, index: int) -> bool:
    """The hand could grasp the cup by moving straight ahead, from where it is at moment `index`.

    That is: the cup's centre lies before the hand (at most 20 cm along the tool's z); the whole cup lies between the
    planes of the open pads (normal to the tool's y), so that no finger would run into it; and the way ahead passes
    the cup's axis at least 1 cm below its rim and above its bottom, so that the pads would meet its wall.
    """
    tool = track.tool[index]
    rotation, origin = tool[:3, :3], tool[:3, 3]
    sideways, ahead = map(float, (track.cup[index] - origin) @ rotation[:, 1:])
    direction = rotation[:, 2]
    level = float(np.hypot(direction[0], direction[1]))
    if level < 1e-6:
        return False
    reach = float((track.cup[index, :2] - origin[:2]) @ direction[:2]) / level**2
    height = float(origin[2] + reach * direction[2] - track.cup[index, 2])
    return (
        0.0 < ahead <= REACH_AHEAD
        and abs(sideways) + cup.radius < float(track.opening[index]) / 2.0
        and abs(height) <= cup.height / 2.0 - EDGE
    )


def lowest_point(track: Track, cup: CupSize) -> NDArray[np.float64]:
    """Height of the cup's lowest point above the table, shape (n,): of a cylinder that may lean."""
    upright = np.abs(track.cup_axis[:, 2])
    leaning = np.sqrt(np.clip(1.0 - upright**2, 0.0, 1.0))
    lowest: NDArray[np.float64] = track.cup[:, 2] - upright * cup.height / 2.0 - leaning * cup.radius
    return lowest


def _approached(track: Track, cup: CupSize, index: int) -> bool:
    return (
        float(track.displacement()[: index + 1].max()) < MOVED_LIMIT
        and track.tilt(index) < TILT_LIMIT
        and grasp_possible(track, cup, index)
    )


def _lifted(track: Track, cup: CupSize) -> bool:
    end = float(track.time[-1])
    if end - float(track.time[0]) < LIFT_TIME:
        return False
    # From the moment at or before the span's start, so that the whole span is covered.
    return bool((lowest_point(track, cup)[track.at(end - LIFT_TIME) :] >= LIFT_HEIGHT).all())
