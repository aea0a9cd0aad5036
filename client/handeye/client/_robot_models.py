"""The robot, and the head that carries the cameras."""

from __future__ import annotations

from typing import Literal

from handeye.client._model import Model


class Robot(Model):
    """What the robot's own sensors say: s, rad, rad/s, m; `still_since` is None while it moves.

    `point` is the tool centre point that the robot's own kinematics make of its joints, world frame.
    """

    world_time: float
    joints: tuple[float, ...]
    velocities: tuple[float, ...]
    point: tuple[float, float, float]
    gripper_opening: float
    moving: bool
    stopped: bool
    still_since: float | None
    lease_holder: str


class RobotDescription(Model):
    """What a robot is: joint names; limits in rad, rad/s, rad/s²; park position in rad; gripper range in m."""

    joint_names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    speed: tuple[float, ...]
    acceleration: tuple[float, ...]
    park: tuple[float, ...]
    gripper_range: float
    clock: Literal["realtime", "lockstep"]


class Head(Model):
    """Where the head points: pan (positive to its left) and tilt (positive up) in rad, world time in s."""

    pan: float
    tilt: float
    moving: bool
    world_time: float


class HeadDescription(Head):
    """Where the head points, and how far, how finely and how fast it turns: rad, rad/s."""

    pan_lower: float
    pan_upper: float
    tilt_lower: float
    tilt_upper: float
    step: float
    speed: float


class Lease(Model):
    """Control of the robot: the secret that moves it, and the s without a sign of life after which it ends."""

    lease: str
    holder: str
    expires_after: float
