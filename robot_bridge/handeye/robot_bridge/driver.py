"""What the robot bridge asks of a robot, simulated, remote or real.

Joint vectors are float64 arrays of shape (number of joints,), in rad, base to wrist. Points are (3,) in m,
world frame. Every command blocks until the motion has ended and returns the state that was *reached*.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

Joints = NDArray[np.float64]

Watch = Callable[[float], None]
"""Called at every control step of a motion with the share done (0..1). Raising brakes the arm to a
standstill; the exception then leaves the command. `Slipping` (`handeye.rpc.errors`) opens the gripper meanwhile: in the
third of a second that an arm may take to stand still, fingers that close shoot away what slips."""


def unwatched(_fraction: float) -> None:
    """The watch of a motion that nobody watches."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How fast to move: shares in [0.001, 1] of the joints' speed and acceleration limits."""

    speed: float = 0.5
    acceleration: float = 0.5


@dataclass(frozen=True, slots=True)
class RobotDescription:
    """What a robot is: joint names; limits in rad, rad/s, rad/s^2; park position; gripper range in m."""

    joint_names: tuple[str, ...]
    lower: Joints
    upper: Joints
    speed: Joints
    acceleration: Joints
    park: Joints
    gripper_range: float
    clock: Literal["realtime", "lockstep"]


@dataclass(frozen=True, slots=True)
class RobotState:
    """What the robot's own sensors say.

    world_time in s; joints are encoder readings in rad, velocities in rad/s; point (3,) is the tool centre point, in m,
    world frame, that the robot's own kinematics make of the encoder readings; gripper_opening is the distance between
    the pads in m; still_since is the world time since when arm and gripper stand still (inf while moving).
    """

    world_time: float
    joints: Joints
    velocities: Joints
    point: NDArray[np.float64]
    gripper_opening: float
    moving: bool
    stopped: bool
    still_since: float
    lease_holder: str = ""


class RobotDriver(Protocol):
    """The six actions of the thesis (4.2.2), and state, advance, stop, reset.

    Errors are those of `handeye.rpc.errors`: `InvalidArgument`, `OutOfLimits`, `Unreachable`, `Busy` (a motion is
    under way), `Stopped` (the software stop is latched).
    """

    @property
    def description(self) -> RobotDescription:
        """What the robot is; does not change."""
        ...

    def state(self) -> RobotState:
        """The newest state; answers also while a motion is under way."""
        ...

    def park(self, pace: Pace = ..., watch: Watch = ...) -> RobotState:
        """Moves to the park position."""
        ...

    def open_gripper(self, watch: Watch = ...) -> RobotState:
        """Opens the gripper fully."""
        ...

    def close_gripper(self, watch: Watch = ...) -> RobotState:
        """Closes the gripper until the fingers meet something or each other."""
        ...

    def move_to_point(self, point: NDArray[np.float64], pace: Pace = ..., watch: Watch = ...) -> RobotState:
        """Moves the tool centre point to `point`, keeping the tool's orientation."""
        ...

    def move_to_joints(self, joints: Joints, pace: Pace = ..., watch: Watch = ...) -> RobotState:
        """Moves to `joints`."""
        ...

    def adjust_joints(self, delta: Joints, pace: Pace = ..., watch: Watch = ...) -> RobotState:
        """Changes the joints by `delta`."""
        ...

    def advance(self, duration: float, watch: Watch = ...) -> RobotState:
        """Lets `duration` s of world time pass while the arm holds still."""
        ...

    def stop(self, reason: str = ...) -> RobotState:
        """Brakes a motion under way, from another thread too, and latches the software stop."""
        ...

    def reset(self) -> RobotState:
        """Clears the software stop; the next move that goes anywhere is ramped."""
        ...

    def close(self) -> None:
        """Releases the robot; motion is braked first."""
        ...
