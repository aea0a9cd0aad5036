"""A robot that refuses what is wrong, one motion at a time, nothing while stopped."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from handeye.robot_bridge.driver import Joints, Pace, RobotDescription, RobotDriver, RobotState, Watch, unwatched
from handeye.robot_bridge.limits import (
    DEFAULT_PACE,
    READING_ERROR,
    check_duration,
    check_joints,
    check_opening,
    check_pace,
    check_vector,
    stopped,
)
from handeye.rpc.errors import Busy, DeadlineExceeded, Slipping, Stopped


class GuardedRobot:
    """Wraps any `RobotDriver` and is one: checks every command before the driver sees it.

    Not finite or wrongly shaped arguments are `InvalidArgument`, joint limits `OutOfLimits`, a second motion is
    `Busy`, any motion while the software stop is latched `Stopped`. Whatever ends a motion with `Stopped` latches
    the stop. The workspace is the driver's to check: it knows the arm's geometry.
    """

    def __init__(self, driver: RobotDriver) -> None:
        self._driver = driver
        self._in_motion = threading.Lock()
        self._stop_reason: str | None = None

    @property
    def description(self) -> RobotDescription:
        """What the robot is."""
        return self._driver.description

    def state(self) -> RobotState:
        """The newest state; it says moving until the next command is welcome."""
        state = self._seen(self._driver.state())
        return replace(state, moving=state.moving or self._in_motion.locked())

    def park(self, pace: Pace = DEFAULT_PACE, watch: Watch = unwatched) -> RobotState:
        """Moves to the park position."""
        with self._motion(watch) as watched:
            check_pace(pace)
            return self._seen(self._driver.park(pace, watched))

    def open_gripper(self, watch: Watch = unwatched) -> RobotState:
        """Opens the gripper fully."""
        with self._motion(watch) as watched:
            return self._seen(self._driver.open_gripper(watched))

    def close_gripper(self, watch: Watch = unwatched) -> RobotState:
        """Closes the gripper until the fingers meet something or each other."""
        with self._motion(watch) as watched:
            return self._seen(self._driver.close_gripper(watched))

    def move_to_point(
        self, point: NDArray[np.float64], pace: Pace = DEFAULT_PACE, watch: Watch = unwatched
    ) -> RobotState:
        """Moves the tool centre point to `point`, (x, y, z) in m, world frame."""
        with self._motion(watch) as watched:
            check_pace(pace)
            target = check_vector("point", point, 3)
            return self._seen(self._driver.move_to_point(target, pace, watched))

    def move_to_joints(self, joints: Joints, pace: Pace = DEFAULT_PACE, watch: Watch = unwatched) -> RobotState:
        """Moves to `joints` in rad."""
        with self._motion(watch) as watched:
            check_pace(pace)
            target = check_vector("joints", joints, len(self.description.joint_names))
            check_joints(self.description, target)
            return self._seen(self._driver.move_to_joints(target, pace, watched))

    def adjust_joints(
        self, delta: Joints, pace: Pace = DEFAULT_PACE, watch: Watch = unwatched, least_opening: float = 0.0
    ) -> RobotState:
        """Changes the joints by `delta` in rad; what is checked is the present reading plus `delta`.

        Once the gripper is closed further than `least_opening`, in m, the arm brakes and the gripper opens: `Slipping`.
        That is felt here at every control step; whoever hears of it over a network hears of it too late.
        """
        with self._motion(watch) as watched:
            check_pace(pace)
            check_opening(self.description, least_opening)
            change = check_vector("delta", delta, len(self.description.joint_names))
            check_joints(self.description, self._driver.state().joints + change, READING_ERROR)

            def feeling(fraction: float) -> None:
                watched(fraction)
                opening = self._driver.state().gripper_opening
                if opening < least_opening:
                    raise Slipping(
                        f"the gripper has closed to {opening:.4f} m, least {least_opening:.4f} m was asked for"
                    )

            return self._seen(self._driver.adjust_joints(change, pace, feeling if least_opening else watched))

    def advance(self, duration: float, watch: Watch = unwatched) -> RobotState:
        """Lets `duration` s of world time pass while the arm holds still."""
        with self._motion(watch) as watched:
            check_duration(duration)
            return self._seen(self._driver.advance(duration, watched))

    def stop(self, reason: str = "") -> RobotState:
        """Brakes a motion under way and latches the software stop; the first reason is the one that is kept."""
        if self._stop_reason is None:
            self._stop_reason = reason or "no reason was given"
        return self._seen(self._driver.stop(self._stop_reason))

    def reset(self) -> RobotState:
        """Clears the software stop; the next move is ramped, by the driver. `Busy` while a motion is under way."""
        with self._exclusive():
            self._stop_reason = None
            return self._seen(self._driver.reset())

    def close(self) -> None:
        """Brakes and releases the robot."""
        self._driver.close()

    def check_not_stopped(self) -> None:
        """Raises `Stopped`, with the reason, while the guard's stop is latched; cheap enough for every step."""
        if self._stop_reason is not None:
            raise stopped(self._stop_reason)

    def wait_until_idle(self, timeout: float) -> None:
        """Returns when no motion is under way; `DeadlineExceeded` after `timeout` s."""
        if not self._in_motion.acquire(timeout=max(timeout, 0.0)):
            raise DeadlineExceeded(f"the motion under way has not ended within {timeout:.2f} s")
        self._in_motion.release()

    @contextmanager
    def _exclusive(self) -> Iterator[None]:
        if not self._in_motion.acquire(blocking=False):
            raise Busy("a motion is under way: wait for its end, cancel it or stop the robot")
        try:
            yield
        finally:
            self._in_motion.release()

    @contextmanager
    def _motion(self, watch: Watch) -> Iterator[Watch]:
        """The one motion under way; yields `watch` made to notice the stop too."""

        def watched(fraction: float) -> None:
            self.check_not_stopped()
            watch(fraction)

        with self._exclusive():
            self.check_not_stopped()
            if self._driver.state().stopped:
                raise stopped("the driver itself stopped it")
            try:
                yield watched
            except Stopped as error:
                self.check_not_stopped()  # the driver may not know the reason
                self.stop(error.message)
                raise

    def _seen(self, state: RobotState) -> RobotState:
        """`state` with the guard's own latch: a driver may forget a stop, the guard does not."""
        return replace(state, stopped=state.stopped or self._stop_reason is not None)
