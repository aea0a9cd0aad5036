"""Serves a robot on the bus: the six actions as long calls under the control lease, state, stop and reset."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from types import TracebackType
from typing import Self

import structlog

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
    ROBOT_STATE,
    ROBOT_STOP,
)
from handeye.proto.v1 import robot_pb2
from handeye.robot_bridge.convert import description_to_message, pace_from_message, state_to_message, vector
from handeye.robot_bridge.driver import RobotDriver, RobotState, Watch
from handeye.robot_bridge.guard import GuardedRobot
from handeye.robot_bridge.lease import HEARTBEAT_PERIOD, LOCKSTEP_PATIENCE, SILENCE_LIMIT, LeaseKeeper
from handeye.robot_bridge.watch import LeaseWatch
from handeye.rpc import Bus, Call
from handeye.rpc.errors import RpcError

_log = structlog.get_logger()

STATE_PERIOD = 0.015
"""Seconds between two states on the stream: a little under 20 ms, so that it is 50 Hz under load too."""


class RobotService:
    """A robot on the bus, from `with` to its end; braked and silent afterwards. The driver stays its owner's to close.

    Motion needs the control lease and its heartbeats. In realtime the arm brakes after 100 ms of silence. In lockstep
    the world stands still after 100 ms and the motion is given up after 1 s. Both latch the software stop.
    """

    def __init__(self, driver: RobotDriver, bus: Bus) -> None:
        self._robot = GuardedRobot(driver)
        self._bus = bus
        self._leases = LeaseKeeper()
        lockstep = self._robot.description.clock == "lockstep"
        self._patience = LOCKSTEP_PATIENCE if lockstep else SILENCE_LIMIT
        self._closing = threading.Event()
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(self._bus.subscribe(ROBOT_HEARTBEAT, self._on_heartbeat))
            publisher = threading.Thread(target=self._publish_states, name="robot-state")
            publisher.start()
            stack.callback(publisher.join)
            stack.callback(self._closing.set)
            stack.enter_context(
                self._bus.serve(
                    {
                        ROBOT_DESCRIBE: self._describe,
                        ROBOT_GET_STATE: self._get_state,
                        ROBOT_ACQUIRE_LEASE: self._acquire_lease,
                        ROBOT_RELEASE_LEASE: self._release_lease,
                        ROBOT_PARK: self._park,
                        ROBOT_OPEN_GRIPPER: self._open_gripper,
                        ROBOT_CLOSE_GRIPPER: self._close_gripper,
                        ROBOT_MOVE_TO_POINT: self._move_to_point,
                        ROBOT_MOVE_TO_JOINTS: self._move_to_joints,
                        ROBOT_ADJUST_JOINTS: self._adjust_joints,
                        ROBOT_ADVANCE: self._advance,
                        ROBOT_STOP: self._stop,
                        ROBOT_RESET: self._reset,
                    }
                )
            )
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._stack:
            self._robot.stop("the robot bridge is shutting down")

    # Lease -----------------------------------------------------------------------------------------------------------

    def _on_heartbeat(self, message: robot_pb2.Heartbeat) -> None:
        self._leases.beat(message.lease_digest)

    def _acquire_lease(self, request: robot_pb2.AcquireLeaseRequest, _call: Call) -> robot_pb2.Lease:
        lease_id = self._leases.acquire(request.holder)
        _log.info("control lease given", holder=request.holder)
        return robot_pb2.Lease(lease_id=lease_id, heartbeat_period=HEARTBEAT_PERIOD, silence_limit=SILENCE_LIMIT)

    def _release_lease(self, request: robot_pb2.ReleaseLeaseRequest, call: Call) -> robot_pb2.RobotState:
        holder = self._leases.holder
        self._leases.release(request.lease_id)
        _log.info("control lease given back", holder=holder)
        self._robot.wait_until_idle(call.time_left())
        return self._message(self._robot.state())

    # What needs no lease ---------------------------------------------------------------------------------------------

    def _describe(self, _request: robot_pb2.DescribeRobotRequest, _call: Call) -> robot_pb2.RobotDescription:
        return description_to_message(self._robot.description)

    def _get_state(self, _request: robot_pb2.GetStateRequest, _call: Call) -> robot_pb2.RobotState:
        return self._message(self._robot.state())

    def _stop(self, request: robot_pb2.StopRequest, call: Call) -> robot_pb2.RobotState:
        reason = request.reason or f"stopped by {call.caller or 'a caller without a name'}"
        _log.warning("software stop", reason=reason, caller=call.caller)
        return self._message(self._robot.stop(reason))

    def _reset(self, _request: robot_pb2.ResetRequest, call: Call) -> robot_pb2.RobotState:
        state = self._robot.reset()
        _log.info("software stop cleared", caller=call.caller)
        return self._message(state)

    # Motion ----------------------------------------------------------------------------------------------------------

    def _park(self, request: robot_pb2.ParkRequest, call: Call) -> robot_pb2.RobotState:
        pace = pace_from_message(request.pace)
        return self._move(request.lease_id, call, lambda watch: self._robot.park(pace, watch))

    def _open_gripper(self, request: robot_pb2.GripperRequest, call: Call) -> robot_pb2.RobotState:
        return self._move(request.lease_id, call, self._robot.open_gripper)

    def _close_gripper(self, request: robot_pb2.GripperRequest, call: Call) -> robot_pb2.RobotState:
        return self._move(request.lease_id, call, self._robot.close_gripper)

    def _move_to_point(self, request: robot_pb2.MoveToPointRequest, call: Call) -> robot_pb2.RobotState:
        point, pace = vector(request.point), pace_from_message(request.pace)
        return self._move(request.lease_id, call, lambda watch: self._robot.move_to_point(point, pace, watch))

    def _move_to_joints(self, request: robot_pb2.MoveToJointsRequest, call: Call) -> robot_pb2.RobotState:
        joints, pace = vector(request.joints), pace_from_message(request.pace)
        return self._move(request.lease_id, call, lambda watch: self._robot.move_to_joints(joints, pace, watch))

    def _adjust_joints(self, request: robot_pb2.AdjustJointsRequest, call: Call) -> robot_pb2.RobotState:
        delta, pace, least = vector(request.delta), pace_from_message(request.pace), request.least_opening
        return self._move(request.lease_id, call, lambda watch: self._robot.adjust_joints(delta, pace, watch, least))

    def _advance(self, request: robot_pb2.AdvanceRequest, call: Call) -> robot_pb2.RobotState:
        return self._move(request.lease_id, call, lambda watch: self._robot.advance(request.duration, watch))

    def _move(self, lease_id: str, call: Call, command: Callable[[Watch], RobotState]) -> robot_pb2.RobotState:
        """One motion under the lease; returns what was reached."""
        with self._leases.in_use(lease_id):
            watch = LeaseWatch(
                self._leases,
                lease_id,
                self._patience,
                interrupted=lambda: self._check_interrupted(call),
                report=lambda fraction: self._report(call, fraction),
            )
            try:
                return self._message(command(watch))
            except RpcError as error:
                _log.warning("motion ended", caller=call.caller, error=type(error).__name__, reason=error.message)
                raise

    def _check_interrupted(self, call: Call) -> None:
        call.check()
        self._robot.check_not_stopped()

    def _report(self, call: Call, fraction: float) -> None:
        state = self._message(self._robot.state())
        call.progress(robot_pb2.MotionProgress(fraction=fraction, state=state))

    # State -----------------------------------------------------------------------------------------------------------

    def _message(self, state: RobotState) -> robot_pb2.RobotState:
        return state_to_message(replace(state, lease_holder=self._leases.holder))

    def _publish_states(self) -> None:
        failing = False
        due = time.monotonic()
        while not self._closing.wait(due - time.monotonic()):
            try:
                self._bus.publish(ROBOT_STATE, self._message(self._robot.state()))
                failing = False
            except Exception:  # whatever a driver raises, the stream goes on when its robot does
                if not failing:
                    _log.exception("no state to publish")
                failing = True
            due = max(due + STATE_PERIOD, time.monotonic())
