"""The truth of the last minutes, one row of numbers for each physics step."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from handeye.rpc.errors import InvalidArgument
from handeye.simulation import kinematics
from handeye.simulation.pose import Pose
from handeye.simulation.scene import STEP, ObjectState, WorldState

Array = NDArray[np.float64]

REACH = 600.0
"""World time that the history reaches back, in s."""

_JOINTS, _FINGERS, _OBJECT = 6, 2, 9


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """One step: joints (6) in rad, fingers (2) in m, for each object position, quaternion and its two touches, and
    the place of each particle of liquid."""

    scene_version: int
    names: tuple[str, ...]
    numbers: Array


class History:
    """The newest rows, of consecutive steps, the last of which is `newest`."""

    def __init__(self) -> None:
        self._rows: deque[Row] = deque(maxlen=round(REACH / STEP) + 1)
        self._newest = -1

    def append(self, row: Row) -> None:
        """Adds the row of the next step; the first is step 0."""
        self._rows.append(row)
        self._newest += 1

    def replace(self, row: Row) -> None:
        """Puts another row in the newest one's place: the scene has changed between two steps."""
        self._rows[-1] = row

    def recall(self, step: int) -> WorldState:
        """The state at a step; `InvalidArgument` when it lies in the future or too far back."""
        oldest = self._newest - len(self._rows) + 1
        if not oldest <= step <= self._newest:
            raise InvalidArgument(
                f"the world at {step * STEP:.4f} s is not known: the history reaches from {oldest * STEP:.4f} s to"
                f" {self._newest * STEP:.4f} s",
                detail="world_time",
            )
        row = self._rows[step - oldest]
        ends = np.cumsum([_JOINTS, _FINGERS, _OBJECT * len(row.names)])
        joints, fingers, objects, liquid = np.split(row.numbers, ends)
        return WorldState(
            world_time=step * STEP,
            scene_version=row.scene_version,
            joints=joints.copy(),
            fingers=fingers.copy(),
            tool=Pose.from_matrix(kinematics.forward(joints)),
            objects=tuple(
                ObjectState(name, Pose(item[:3].copy(), item[3:7].copy()), bool(item[7]), bool(item[8]))
                for name, item in zip(row.names, objects.reshape(-1, _OBJECT), strict=True)
            ),
            liquid=liquid.reshape(-1, 3).copy(),
        )
