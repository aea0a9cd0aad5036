"""The robot as the rest of the bus sees it: a `RobotDriver` whose commands are calls to the robot bridge."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import TypeVar

import numpy as np
import structlog
from google.protobuf.message import Message
from numpy.typing import NDArray

from handeye.proto.methods import (
    ROBOT_ACQUIRE_LEASE,
    ROBOT_ADJUST_JOINTS,
    ROBOT_ADVANCE,
    ROBOT_CLOSE_GRIPPER,
    ROBOT_DESCRIBE,
    ROBOT_GET_STATE,
    ROBOT_HEARTBEAT,
    ROBOT_MOVE_TO_JOINTS,
    ROBOT_MOVE_TO_POINT,
    ROBOT_OPEN_GRIPPER,
    ROBOT_PARK,
    ROBOT_RELEASE_LEASE,
    ROBOT_RESET,
    ROBOT_STOP,
)
from handeye.proto.v1 import robot_pb2
from handeye.robot_bridge.convert import description_from_message, pace_to_message, state_from_message
from handeye.robot_bridge.driver import Joints, Pace, RobotDescription, RobotState, Watch, unwatched
from handeye.robot_bridge.lease import HEARTBEAT_PERIOD, lease_digest
from handeye.robot_bridge.limits import DEFAULT_PACE, check_duration, check_vector
from handeye.rpc import Bus, Method
from handeye.rpc.errors import DeadlineExceeded, RpcError, Unauthorised, Unavailable

_log = structlog.get_logger()

CALL_TIMEOUT = 2.0
"""Seconds that a call without motion may take."""
STOP_TIMEOUT = 5.0
"""Seconds that a stop may take: it answers when the arm stands still."""
SPARE_TIME = 30.0
"""Seconds that a motion may take beyond twice what it is expected to take: silence and death are noticed earlier."""
SLOWEST_SHARE = 0.2
"""After a reset the first move may be slowed down to this share; deadlines allow for it."""

Request = TypeVar("Request", bound=Message)


def heartbeat(bus: Bus, lease_id: str) -> Callable[[], None]:
    """What the holder of `lease_id` calls every 20 ms while it waits for a motion: `bus.call(on_tick=...)`."""
    message = robot_pb2.Heartbeat(lease_digest=lease_digest(lease_id))
    return lambda: bus.publish(ROBOT_HEARTBEAT, message)


class RemoteRobot:
    """A `RobotDriver` on the bus. Moving commands need the lease: `with robot.lease(): robot.park()`.

    One thread moves it at a time; `state` and `stop` may be called from others. Errors are the bridge's, and
    `Unavailable` or `DeadlineExceeded` when it cannot be reached.
    """

    def __init__(self, bus: Bus, holder: str = "coordinator") -> None:
        self._bus = bus
        self._holder = holder
        self._lease_id = ""

    @property
    def lease_id(self) -> str:
        """The secret of the lease that is held, for the head's moves; empty without a lease."""
        return self._lease_id

    @contextmanager
    def lease(self) -> Iterator[None]:
        """Holds the control lease; `Busy` while another holder is alive. At the end a motion under way is braked."""
        request = robot_pb2.AcquireLeaseRequest(holder=self._holder)
        self._lease_id = self._bus.call(ROBOT_ACQUIRE_LEASE, request, timeout=CALL_TIMEOUT).lease_id
        try:
            yield
        finally:
            self._release()

    def beat(self) -> None:
        """Sends a heartbeat, for the holder's other waits: a lease silent for 2 s may be taken over."""
        if self._lease_id:
            heartbeat(self._bus, self._lease_id)()

    @cached_property
    def description(self) -> RobotDescription:
        """What the robot is; asked once."""
        message = self._bus.call(ROBOT_DESCRIBE, robot_pb2.DescribeRobotRequest(), timeout=CALL_TIMEOUT)
        return description_from_message(message)

    def state(self) -> RobotState:
        """The newest state."""
        return state_from_message(self._bus.call(ROBOT_GET_STATE, robot_pb2.GetStateRequest(), timeout=CALL_TIMEOUT))

    def park(self, pace: Pace = DEFAULT_PACE, watch: Watch = unwatched) -> RobotState:
        """Moves to the park position."""
        request = robot_pb2.ParkRequest(lease_id=self._lease_id, pace=pace_to_message(pace))
        return self._move(ROBOT_PARK, request, self._longest_move(pace), watch)

    def open_gripper(self, watch: Watch = unwatched) -> RobotState:
        """Opens the gripper fully."""
        return self._move(ROBOT_OPEN_GRIPPER, robot_pb2.GripperRequest(lease_id=self._lease_id), 0.0, watch)

    def close_gripper(self, watch: Watch = unwatched) -> RobotState:
        """Closes the gripper until the fingers meet something or each other."""
        return self._move(ROBOT_CLOSE_GRIPPER, robot_pb2.GripperRequest(lease_id=self._lease_id), 0.0, watch)

    def move_to_point(
        self, point: NDArray[np.float64], pace: Pace = DEFAULT_PACE, watch: Watch = unwatched
    ) -> RobotState:
        """Moves the tool centre point to `point`, (x, y, z) in m, world frame."""
        request = robot_pb2.MoveToPointRequest(
            lease_id=self._lease_id, pace=pace_to_message(pace), point=check_vector("point", point, 3).tolist()
        )
        return self._move(ROBOT_MOVE_TO_POINT, request, self._longest_move(pace), watch)

    def move_to_joints(self, joints: Joints, pace: Pace = DEFAULT_PACE, watch: Watch = unwatched) -> RobotState:
        """Moves to `joints` in rad."""
        request = robot_pb2.MoveToJointsRequest(
            lease_id=self._lease_id, pace=pace_to_message(pace), joints=self._vector("joints", joints)
        )
        return self._move(ROBOT_MOVE_TO_JOINTS, request, self._longest_move(pace), watch)

    def adjust_joints(
        self, delta: Joints, pace: Pace = DEFAULT_PACE, watch: Watch = unwatched, least_opening: float = 0.0
    ) -> RobotState:
        """Changes the joints by `delta` (rad); `Slipping` if the gripper is closed further than `least_opening` (m)."""
        request = robot_pb2.AdjustJointsRequest(
            lease_id=self._lease_id,
            pace=pace_to_message(pace),
            delta=self._vector("delta", delta),
            least_opening=least_opening,
        )
        return self._move(ROBOT_ADJUST_JOINTS, request, self._longest_move(pace), watch)

    def advance(self, duration: float, watch: Watch = unwatched) -> RobotState:
        """Lets `duration` s of world time pass while the arm holds still."""
        check_duration(duration)
        request = robot_pb2.AdvanceRequest(lease_id=self._lease_id, duration=duration)
        return self._move(ROBOT_ADVANCE, request, duration, watch)

    def stop(self, reason: str = "") -> RobotState:
        """Brakes a motion under way and latches the software stop; needs no lease."""
        return state_from_message(
            self._bus.call(ROBOT_STOP, robot_pb2.StopRequest(reason=reason), timeout=STOP_TIMEOUT)
        )

    def reset(self) -> RobotState:
        """Clears the software stop; the next move is ramped."""
        return state_from_message(self._bus.call(ROBOT_RESET, robot_pb2.ResetRequest(), timeout=CALL_TIMEOUT))

    def close(self) -> None:
        """Gives a lease that is still held back, which brakes; the bus stays its owner's to close."""
        if self._lease_id:
            self._release()

    def _move(
        self, method: Method[Request, robot_pb2.RobotState], request: Request, expected: float, watch: Watch
    ) -> RobotState:
        """One long call with heartbeats; `expected` in s. When it raises, the arm stands still."""
        if not self._lease_id:
            raise Unauthorised("moving the robot needs the control lease: use `with robot.lease():`")
        beat = heartbeat(self._bus, self._lease_id)
        done = 0.0
        interrupted = False

        def on_progress(progress: robot_pb2.MotionProgress) -> None:
            nonlocal done
            done = progress.fraction

        def on_tick() -> None:
            nonlocal interrupted
            beat()
            try:
                watch(done)
            except BaseException:
                interrupted = True
                raise

        timeout = SPARE_TIME + 2.0 * expected
        try:
            reached = self._bus.call(method, request, timeout=timeout, on_progress=on_progress, on_tick=on_tick)
        except BaseException as error:
            if interrupted or not isinstance(error, RpcError):
                self._wait_until_still()
            raise
        return state_from_message(reached)

    def _wait_until_still(self) -> None:
        """Waits for a cancelled motion to end; best effort, because the reason for the cancel matters more."""
        deadline = time.monotonic() + STOP_TIMEOUT
        try:
            while self.state().moving and time.monotonic() < deadline:
                time.sleep(HEARTBEAT_PERIOD)
        except RpcError as error:
            _log.warning("cannot tell whether the arm stands still", error=error.message)

    def _release(self) -> None:
        lease_id, self._lease_id = self._lease_id, ""
        try:
            request = robot_pb2.ReleaseLeaseRequest(lease_id=lease_id)
            self._bus.call(ROBOT_RELEASE_LEASE, request, timeout=STOP_TIMEOUT)
        except (Unavailable, DeadlineExceeded, Unauthorised) as error:
            # The bridge is gone or somebody took the lease over: there is nothing left to give back.
            _log.warning("control lease not given back", error=error.message)

    def _vector(self, name: str, values: NDArray[np.float64]) -> list[float]:
        return [float(value) for value in check_vector(name, values, len(self.description.joint_names))]

    def _longest_move(self, pace: Pace) -> float:
        """Seconds that the longest move takes at `pace`: quintic profile from limit to limit."""
        robot = self.description
        span = robot.upper - robot.lower
        by_speed = 1.875 * span / (robot.speed * min(pace.speed, SLOWEST_SHARE))
        by_acceleration = np.sqrt(5.774 * span / (robot.acceleration * min(pace.acceleration, SLOWEST_SHARE)))
        return float(np.maximum(by_speed, by_acceleration).max())
