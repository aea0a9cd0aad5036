"""The simulated PUMA 560 as a robot driver."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from handeye.robot_bridge.driver import Joints, Pace, RobotDescription, RobotState, Watch, unwatched
from handeye.robot_bridge.limits import (
    DEFAULT_PACE,
    READING_ERROR,
    check_duration,
    check_joints,
    check_pace,
    check_vector,
    stopped,
)
from handeye.rpc.errors import Busy, Internal, OutOfLimits, Slipping, Unreachable
from handeye.simulation import gripper, kinematics, puma
from handeye.simulation.grasping import PARK
from handeye.simulation.scene import STEP
from handeye.simulation.world import World

RAMP = Pace(0.2, 0.2)
"""The first move after the start or a reset is no faster than this."""
RAMP_DISTANCE = 0.01
"""A motion that brought no joint further than this, in rad, was no first move."""
TABLE_CLEARANCE = 0.005
"""No part of hand or arm may be sent closer to the table than this, in m."""

_LEAST_SAMPLES = 12
_SAMPLE_DISTANCE = 0.03  # rad: no joint turns further between two samples of a path
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
        self._ramped = True

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
            joints = world.encoders()
            return RobotState(
                world_time=world.time,
                joints=joints,
                velocities=world.velocities(),
                point=kinematics.forward(joints)[:3, 3],
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
        target = check_vector("point", point, 3)
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
        target = check_vector("joints", joints, 6)
        with self._commanding():
            return self._move(target, pace, watch)

    def adjust_joints(self, delta: Joints, pace: Pace = DEFAULT_PACE, watch: Watch = unwatched) -> RobotState:
        """Changes the joints by `delta` (6,), rad, from where they were last sent."""
        change = check_vector("delta", delta, 6)
        with self._commanding():
            return self._move(self._world.motors() + change, pace, watch)

    def advance(self, duration: float, watch: Watch = unwatched) -> RobotState:
        """Lets `duration` s of world time pass, rounded up to whole physics steps."""
        check_duration(duration)
        with self._commanding(), self._world.advancing():
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
            with self._world.lock:
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
            with self._starting():
                self._world.start_gripper(opening=opening)
            self._follow(lambda: not self._world.busy, lambda: self._world.gripper_fraction, watch)
            return self.state()

    def _move(self, goal: Joints, pace: Pace, watch: Watch) -> RobotState:
        check_pace(pace)
        pace = self._ramp(pace)
        check_joints(self.description, goal, READING_ERROR)
        goal = np.clip(goal, puma.LOWER, puma.UPPER)
        start = self._world.motors()
        _check_workspace(start, goal)
        with self._starting():
            motion = self._world.start_motion(goal, speed_share=pace.speed, acceleration_share=pace.acceleration)
        self._follow(lambda: not self._world.busy, lambda: motion.fraction, watch)
        if np.abs(goal - start).max() > RAMP_DISTANCE:
            self._ramped = False
        return self.state()

    def _ramp(self, pace: Pace) -> Pace:
        if not self._ramped:
            return pace
        return Pace(min(pace.speed, RAMP.speed), min(pace.acceleration, RAMP.acceleration))

    def _follow(self, done: Callable[[], bool], fraction: Callable[[], float], watch: Watch) -> None:
        """Lets the world go on until `done`; what `watch` raises, or a stop, brakes the arm and leaves then.

        `Slipping` opens the gripper meanwhile.
        """
        failure: BaseException | None = None
        while not done():
            self._pass_step()
            if failure is None and self._stop_reason is None:
                try:
                    watch(fraction())
                except BaseException as error:
                    failure = error
                    self._world.brake()
                    if isinstance(error, Slipping):
                        self._world.let_go()
            if self._stop_reason is not None:
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

    @contextmanager
    def _starting(self) -> Iterator[None]:
        """Whatever starts in here starts in one step with a last look at the stop: it comes before, or it brakes."""
        with self._world.lock:
            self._require_unstopped()
            yield

    def _wait_for_command(self, timeout: float) -> None:
        """Waits until the command under way has left; not from inside it (its `watch`)."""
        if self._commander == threading.get_ident():
            return
        if self._command.acquire(timeout=timeout):
            self._command.release()

    def _require_unstopped(self) -> None:
        if self._stop_reason is not None:
            raise stopped(self._stop_reason)


def _check_workspace(start: Joints, goal: Joints) -> None:
    """`OutOfLimits` when fingers, wrist or elbow would come too near to the table, on the way or at its end."""
    samples = max(_LEAST_SAMPLES, math.ceil(np.abs(goal - start).max() / _SAMPLE_DISTANCE))
    for share in np.arange(1, samples + 1) / samples:
        height = kinematics.lowest_point(start + share * (goal - start))
        if height < TABLE_CLEARANCE:
            raise OutOfLimits(
                f"the arm would come to {height * 1000:.0f} mm above the table; {TABLE_CLEARANCE * 1000:.0f} mm is the"
                " least that is allowed",
                detail="workspace",
            )
