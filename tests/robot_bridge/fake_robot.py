"""A robot without physics that keeps the `RobotDriver` contract: what the bridge's tests move."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from handeye.robot_bridge.driver import Joints, Pace, RobotDescription, RobotState, Watch, unwatched
from handeye.robot_bridge.limits import DEFAULT_PACE, check_pace
from handeye.rpc.errors import Busy, InvalidArgument, OutOfLimits, Stopped, Unreachable

STEP = 1 / 240  # s
N = 3


class FakeRobot:
    """Three joints that go straight to their targets; the tool's point is the joint vector."""

    def __init__(self, clock: Literal["realtime", "lockstep"] = "lockstep") -> None:
        self._description = RobotDescription(
            joint_names=("waist", "shoulder", "elbow"),
            lower=np.array([-2.0, -1.5, -1.0]),
            upper=np.array([2.0, 1.5, 1.0]),
            speed=np.full(N, 1.0),
            acceleration=np.full(N, 4.0),
            park=np.array([0.0, -0.5, 0.5]),
            gripper_range=0.09,
            clock=clock,
        )
        self._joints = self._description.park.copy()
        self._opening = 0.09
        self._steps = 0
        self._still_since = 0.0
        self._latched = False
        self._in_motion = threading.Lock()
        self._ramped = False
        self.tolerance = 0.0
        """How far beyond the limits the fake itself goes, in rad."""
        self.wall_step = STEP if clock == "realtime" else 0.0
        """Wall time in s that a step takes."""

    @property
    def description(self) -> RobotDescription:
        return self._description

    @property
    def time(self) -> float:
        return self._steps * STEP

    def state(self) -> RobotState:
        moving = self._in_motion.locked()
        return RobotState(
            world_time=self.time,
            joints=self._joints.copy(),
            velocities=np.zeros(N),
            point=self._joints.copy(),
            gripper_opening=self._opening,
            moving=moving,
            stopped=self._latched,
            still_since=math.inf if moving else self._still_since,
        )

    def park(self, pace: Pace = DEFAULT_PACE, watch: Watch = unwatched) -> RobotState:
        return self.move_to_joints(self._description.park, pace, watch)

    def open_gripper(self, watch: Watch = unwatched) -> RobotState:
        return self._grip(self._description.gripper_range, watch)

    def close_gripper(self, watch: Watch = unwatched) -> RobotState:
        return self._grip(0.0, watch)

    def move_to_point(
        self, point: NDArray[np.float64], pace: Pace = DEFAULT_PACE, watch: Watch = unwatched
    ) -> RobotState:
        _check(point, 3)
        if np.linalg.norm(point) > 1.0:
            raise Unreachable(f"no joint position reaches {point}")
        return self.move_to_joints(np.asarray(point), pace, watch)

    def move_to_joints(self, joints: Joints, pace: Pace = DEFAULT_PACE, watch: Watch = unwatched) -> RobotState:
        _check(joints, N)
        check_pace(pace)
        for name, value, lower, upper in zip(
            self._description.joint_names, joints, self._description.lower, self._description.upper, strict=True
        ):
            if not lower - self.tolerance <= value <= upper + self.tolerance:
                raise OutOfLimits(f"{name} would be {value}")
        share = min(pace.speed, 0.2) if self._ramped else pace.speed
        start = self._joints.copy()
        duration = float(np.max(np.abs(joints - start) / (self._description.speed * share)))

        def go(fraction: float) -> None:
            self._joints = start + fraction * (joints - start)

        reached = self._run(duration, go, watch)
        self._ramped = self._ramped and float(np.abs(joints - start).max()) < 0.01
        return reached

    def adjust_joints(self, delta: Joints, pace: Pace = DEFAULT_PACE, watch: Watch = unwatched) -> RobotState:
        _check(delta, N)
        return self.move_to_joints(self._joints + delta, pace, watch)

    def advance(self, duration: float, watch: Watch = unwatched) -> RobotState:
        if not 0.0 <= duration < math.inf:
            raise InvalidArgument(f"duration {duration}")
        return self._run(duration, lambda _: None, watch)

    def stop(self, reason: str = "") -> RobotState:
        self._latched = True
        return self.state()

    def reset(self) -> RobotState:
        self._latched = False
        self._ramped = True
        return self.state()

    def close(self) -> None:
        self._latched = True

    def _grip(self, opening: float, watch: Watch) -> RobotState:
        start = self._opening

        def go(fraction: float) -> None:
            self._opening = start + fraction * (opening - start)

        return self._run(0.2, go, watch)

    def _run(self, duration: float, go: Callable[[float], None], watch: Watch) -> RobotState:
        if not self._in_motion.acquire(blocking=False):
            raise Busy("a motion is under way")
        try:
            steps = math.ceil(duration / STEP)
            for step in range(1, steps + 1):
                if self._latched:
                    raise Stopped("the robot is stopped")
                watch(step / steps)
                if self.wall_step:
                    time.sleep(self.wall_step)
                self._steps += 1
                go(step / steps)
            if self._latched:
                raise Stopped("the robot is stopped")
        finally:
            self._still_since = self.time
            self._in_motion.release()
        return self.state()


def _check(values: NDArray[np.float64], size: int) -> None:
    if np.shape(values) != (size,) or not np.isfinite(values).all():
        raise InvalidArgument(f"not {size} finite numbers: {values}")
