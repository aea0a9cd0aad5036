"""The simulated PUMA 560 as a robot driver."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from handeye.robot_bridge.driver import Joints, Pace, RobotDescription, RobotState, Watch, unwatched
from handeye.rpc.errors import Busy, Internal, InvalidArgument, OutOfLimits, Stopped, Unreachable
from handeye.simulation import gripper, kinematics, puma
from handeye.simulation.grasping import PARK
from handeye.simulation.scene import STEP
from handeye.simulation.world import World

DEFAULT_PACE = Pace()
RAMP = Pace(0.2, 0.2)
"""The first move after a reset is no faster than this."""
TABLE_CLEARANCE = 0.005
"""No part of hand or arm may be sent closer to the table than this, in m."""

_PATH_SAMPLES = 12
_LIMIT_TOLERANCE = 1e-3  # rad: backlash and encoder steps may make a reading look a little beyond a limit
_TICK_TIMEOUT = 2.0  # s of wall time without a tick of the realtime clock that mean it is stuck
_BRAKE_TIMEOUT = 2.0


class SimulatedRobot:
    """A `RobotDriver` on a `World`, which stays its owner's to close.

    In lockstep a command steps the world in the calling thread, as fast as it goes; in realtime the world's clock steps
    it and the command waits. `state` and `stop` may be called from any thread; a second command meanwhile is `Busy`.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._command = threading.Lock()
        self._commander: int | None = None
        self._stop_reason: str | None = None
        self._ramped = False

    @property
    def description(self) -> RobotDescription:
        """Joints and limits of the PUMA 560."""
        return RobotDescription(
            joint_names=puma.JOINT_NAMES,
            lower=puma.LOWER.copy(),
            upper=puma.UPPER.copy(),
            speed=puma.SPEED.copy(),
            acceleration=puma.ACCELERATION.copy(),
            park=PARK.copy(),
            gripper_range=gripper.RANGE,
            clock=self._world.clock,
        )

    def state(self) -> RobotState:
        """The newest state."""
        world = self._world
        with world.lock:
            return RobotState(
                world_time=world.time,
                joints=world.encoders(),
                velocities=world.velocities(),
                gripper_opening=world.gripper_opening(),
                moving=world.busy or math.isinf(world.still_since),
                stopped=self._stop_reason is not None,
                still_since=world.still_since,
            )

    def park(self, pace: Pace = DEFAULT_PACE, watch: Watch = unwatched) -> RobotState:
        """Moves to the park position."""
        return self.move_to_joints(PARK, pace, watch)

    def open_gripper(self, watch: Watch = unwatched) -> RobotState:
        """Opens the gripper fully."""
        return self._move_gripper(True, watch)

    def close_gripper(self, watch: Watch = unwatched) -> RobotState:
        """Closes the gripper until the fingers meet something or each other; the grip's force stays on."""
        return self._move_gripper(False, watch)

    def move_to_point(
        self, point: NDArray[np.float64], pace: Pace = DEFAULT_PACE, watch: Watch = unwatched
    ) -> RobotState:
        """Moves the tool centre point to `point` (3,), m, world frame, keeping the tool's orientation.

        Of the joint positions that reach it the nearest is taken. Raises `Unreachable` when there is none.
        """
        target = _vector("point", point, 3)
        with self._commanding():
            joints = self._world.motors()
            pose = kinematics.forward(joints)
            pose[:3, 3] = target
            solutions = kinematics.inverse(pose)
            if not len(solutions):
                x, y, z = target
                raise Unreachable(
                    f"no joint position brings the tool to ({x:.3f}, {y:.3f}, {z:.3f}) m with its present orientation"
                )
            return self._move(kinematics.nearest(solutions, joints), pace, watch)

    def move_to_joints(self, joints: Joints, pace: Pace = DEFAULT_PACE, watch: Watch = unwatched) -> RobotState:
        """Moves to `joints` (6,), rad."""
        target = _vector("joints", joints, 6)
        with self._commanding():
            return self._move(target, pace, watch)

    def adjust_joints(self, delta: Joints, pace: Pace = DEFAULT_PACE, watch: Watch = unwatched) -> RobotState:
        """Changes the joints by `delta` (6,), rad, from where they were last sent."""
        change = _vector("delta", delta, 6)
        with self._commanding():
            return self._move(self._world.motors() + change, pace, watch)

    def advance(self, duration: float, watch: Watch = unwatched) -> RobotState:
        """Lets `duration` s of world time pass, rounded up to whole physics steps."""
        if not (math.isfinite(duration) and duration >= 0):
            raise InvalidArgument(f"duration must be a finite number of seconds, not below zero; got {duration}")
        with self._commanding():
            steps = math.ceil(duration / STEP - 1e-6)
            first = self._world.ticks

            def fraction() -> float:
                return min(1.0, (self._world.ticks - first) / steps)

            if steps:
                self._follow(lambda: self._world.ticks - first >= steps, fraction, watch)
            return self.state()

    def stop(self, reason: str = "") -> RobotState:
        """Brakes a motion under way and latches the software stop; returns when the arm stands, or after 2 s."""
        with self._world.lock:
            self._stop_reason = reason or "no reason was given"
            self._world.brake()
        self._wait_for_command(_BRAKE_TIMEOUT)
        return self.state()

    def reset(self) -> RobotState:
        """Clears the software stop; the next move is ramped. `Busy` while a motion is still braking."""
        if not self._command.acquire(blocking=False):
            raise Busy("the robot is still braking; reset it when it stands")
        try:
            self._stop_reason = None
            self._ramped = True
        finally:
            self._command.release()
        return self.state()

    def close(self) -> None:
        """Brakes a motion under way; the world is not closed."""
        self.stop("the driver was closed")

    def _move_gripper(self, opening: bool, watch: Watch) -> RobotState:
        with self._commanding():
            self._world.start_gripper(opening=opening)
            self._follow(lambda: not self._world.busy, lambda: self._world.gripper_fraction, watch)
            return self.state()

    def _move(self, goal: Joints, pace: Pace, watch: Watch) -> RobotState:
        pace = self._ramp(_checked(pace))
        goal = _within_limits(goal)
        _check_workspace(self._world.motors(), goal)
        motion = self._world.start_motion(goal, speed_share=pace.speed, acceleration_share=pace.acceleration)
        self._ramped = False
        self._follow(lambda: not self._world.busy, lambda: motion.fraction, watch)
        return self.state()

    def _ramp(self, pace: Pace) -> Pace:
        if not self._ramped:
            return pace
        return Pace(min(pace.speed, RAMP.speed), min(pace.acceleration, RAMP.acceleration))

    def _follow(self, done: Callable[[], bool], fraction: Callable[[], float], watch: Watch) -> None:
        """Lets the world go on until `done`; what `watch` raises, or a stop, brakes the arm and leaves then."""
        failure: BaseException | None = None
        while not done():
            self._pass_step()
            if failure is None and self._stop_reason is None:
                try:
                    watch(fraction())
                except BaseException as error:
                    failure = error
                    self._world.brake()
            if (failure is not None or self._stop_reason is not None) and not self._world.busy:
                break
        if failure is not None:
            raise failure
        self._require_unstopped()

    def _pass_step(self) -> None:
        if self._world.clock == "lockstep":
            self._world.step()
        elif not self._world.wait_for_tick(self._world.ticks, _TICK_TIMEOUT):
            raise Internal(f"the world's clock has not ticked for {_TICK_TIMEOUT:g} s")

    @contextmanager
    def _commanding(self) -> Iterator[None]:
        """Holds the one command that may run; refuses while stopped."""
        if not self._command.acquire(blocking=False):
            raise Busy("a motion is under way; wait for its end or stop the robot")
        self._commander = threading.get_ident()
        try:
            self._require_unstopped()
            yield
        finally:
            self._commander = None
            self._command.release()

    def _wait_for_command(self, timeout: float) -> None:
        """Waits until the command under way has left; not from inside it (its `watch`)."""
        if self._commander == threading.get_ident():
            return
        if self._command.acquire(timeout=timeout):
            self._command.release()

    def _require_unstopped(self) -> None:
        if self._stop_reason is not None:
            raise Stopped(f"the robot is stopped ({self._stop_reason}); reset it first")


def _vector(name: str, values: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    vector = np.asarray(values, dtype=np.float64)
    if vector.shape != (size,) or not np.isfinite(vector).all():
        raise InvalidArgument(f"{name} must be {size} finite numbers, got {np.asarray(values).tolist()}", detail=name)
    return vector


def _checked(pace: Pace) -> Pace:
    for name, share in (("speed", pace.speed), ("acceleration", pace.acceleration)):
        if not 0.0 < share <= 1.0:
            raise InvalidArgument(f"pace.{name} must be a share in (0, 1], got {share}", detail=name)
    return pace


def _within_limits(goal: Joints) -> Joints:
    outside = np.flatnonzero((goal < puma.LOWER - _LIMIT_TOLERANCE) | (goal > puma.UPPER + _LIMIT_TOLERANCE))
    if outside.size:
        wrong = "; ".join(
            f"joint {puma.JOINT_NAMES[i]} would be at {goal[i]:.4f} rad, its limits are"
            f" [{puma.LOWER[i]:.4f}, {puma.UPPER[i]:.4f}] rad"
            for i in outside
        )
        raise OutOfLimits(wrong, detail=puma.JOINT_NAMES[outside[0]])
    return np.clip(goal, puma.LOWER, puma.UPPER)


def _check_workspace(start: Joints, goal: Joints) -> None:
    """`OutOfLimits` when fingers, wrist or elbow would come too near to the table, on the way or at its end."""
    for share in np.arange(1, _PATH_SAMPLES + 1) / _PATH_SAMPLES:
        height = kinematics.lowest_point(start + share * (goal - start))
        if height < TABLE_CLEARANCE:
            raise OutOfLimits(
                f"the arm would come to {height * 1000:.0f} mm above the table; {TABLE_CLEARANCE * 1000:.0f} mm is the"
                " least that is allowed",
                detail="workspace",
            )
