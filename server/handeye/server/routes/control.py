"""Control of arm, gripper and head: the lease, the six actions, the head's moves."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from fastapi import APIRouter, Header, Response

from handeye.camera_bridge.driver import HeadState
from handeye.robot_bridge.driver import Pace, RobotState
from handeye.server.control import SILENCE_LIMIT, Move
from handeye.server.coordinator import Coordinator
from handeye.server.job import Job
from handeye.server.problem_responses import responses
from handeye.server.results import HeadInfo, JobView
from handeye.server.routes import CoordinatorDep
from handeye.server.routes.once import Once, OnceDep
from handeye.server.routes.robot import robot_info
from handeye.server.schemas.robot import (
    AdjustJoints,
    Advance,
    HeadDescription,
    LeaseGiven,
    LeaseKept,
    LeaseRequest,
    MoveToJoints,
    MoveToPoint,
    Paced,
    PaceRequest,
    RobotDescriptionInfo,
    TurnHead,
)

router = APIRouter(prefix="/v1", tags=["control"])

ControlLease = Annotated[
    str, Header(alias="Control-Lease", max_length=100, description="The lease that POST /v1/robot/lease gave.")
]

_MOVES = responses(409, 502, 504)
_PACED = Paced()


@router.post("/robot/lease", status_code=201, responses=_MOVES)
def take_control(request: LeaseRequest, coordinator: CoordinatorDep) -> LeaseGiven:
    """Takes control of robot and head, for as long as a sign of life comes every two seconds.

    Every request that carries the header Control-Lease is one. Two seconds after the last one a motion under way is
    braked, and control is free.
    """
    if (job := coordinator.jobs.acting) is not None:
        raise coordinator.jobs.busy(job)
    lease = coordinator.control.acquire(request.holder)
    return LeaseGiven(lease=lease, holder=request.holder, expires_after=SILENCE_LIMIT)


@router.put("/robot/lease", responses=responses(409))
async def keep_control(control_lease: ControlLease, coordinator: CoordinatorDep) -> LeaseKept:
    """A sign of life of who has control."""
    return LeaseKept(holder=coordinator.control.beat(control_lease), expires_after=SILENCE_LIMIT)


@router.delete("/robot/lease", status_code=204, responses=responses(409))
def give_control_back(control_lease: ControlLease, coordinator: CoordinatorDep) -> None:
    """Gives control back; a motion under way is braked first."""
    coordinator.control.release(control_lease)


@router.get("/robot/description", responses=responses(502, 504))
def describe_robot(coordinator: CoordinatorDep) -> RobotDescriptionInfo:
    """What the robot is: joints with their limits, park position, gripper, clock."""
    robot = coordinator.robot.description
    return RobotDescriptionInfo(
        joint_names=robot.joint_names,
        lower=tuple(robot.lower.tolist()),
        upper=tuple(robot.upper.tolist()),
        speed=tuple(robot.speed.tolist()),
        acceleration=tuple(robot.acceleration.tolist()),
        park=tuple(robot.park.tolist()),
        gripper_range=robot.gripper_range,
        clock=robot.clock,
    )


@router.post("/robot/actions/park", status_code=202, response_model=JobView, responses=_MOVES)
def park(control_lease: ControlLease, coordinator: CoordinatorDep, once: OnceDep, request: Paced = _PACED) -> Response:
    """Moves to the park position."""
    return _move(coordinator, once, control_lease, "park", lambda robot, watch: robot.park(_pace(request.pace), watch))


@router.post("/robot/actions/open_gripper", status_code=202, response_model=JobView, responses=_MOVES)
def open_gripper(control_lease: ControlLease, coordinator: CoordinatorDep, once: OnceDep) -> Response:
    """Opens the gripper fully."""
    return _move(coordinator, once, control_lease, "open_gripper", lambda robot, watch: robot.open_gripper(watch))


@router.post("/robot/actions/close_gripper", status_code=202, response_model=JobView, responses=_MOVES)
def close_gripper(control_lease: ControlLease, coordinator: CoordinatorDep, once: OnceDep) -> Response:
    """Closes the gripper until the fingers meet something or each other."""
    return _move(coordinator, once, control_lease, "close_gripper", lambda robot, watch: robot.close_gripper(watch))


@router.post("/robot/actions/move_to_point", status_code=202, response_model=JobView, responses=_MOVES)
def move_to_point(
    control_lease: ControlLease, request: MoveToPoint, coordinator: CoordinatorDep, once: OnceDep
) -> Response:
    """Moves the tool centre point to a point of the world; the tool keeps its orientation."""
    point, pace = np.array(request.point), _pace(request.pace)
    return _move(
        coordinator, once, control_lease, "move_to_point", lambda robot, watch: robot.move_to_point(point, pace, watch)
    )


@router.post("/robot/actions/move_to_joints", status_code=202, response_model=JobView, responses=_MOVES)
def move_to_joints(
    control_lease: ControlLease, request: MoveToJoints, coordinator: CoordinatorDep, once: OnceDep
) -> Response:
    """Moves to joint positions."""
    joints, pace = np.array(request.joints), _pace(request.pace)
    return _move(
        coordinator,
        once,
        control_lease,
        "move_to_joints",
        lambda robot, watch: robot.move_to_joints(joints, pace, watch),
    )


@router.post("/robot/actions/adjust_joints", status_code=202, response_model=JobView, responses=_MOVES)
def adjust_joints(
    control_lease: ControlLease, request: AdjustJoints, coordinator: CoordinatorDep, once: OnceDep
) -> Response:
    """Changes the joint positions by differences."""
    delta, pace = np.array(request.delta), _pace(request.pace)
    return _move(
        coordinator, once, control_lease, "adjust_joints", lambda robot, watch: robot.adjust_joints(delta, pace, watch)
    )


@router.post("/robot/actions/advance", status_code=202, response_model=JobView, responses=_MOVES)
def advance(control_lease: ControlLease, request: Advance, coordinator: CoordinatorDep, once: OnceDep) -> Response:
    """Lets world time pass while the arm holds still. In lockstep this and the moves are all that advances it."""
    return _move(
        coordinator, once, control_lease, "advance", lambda robot, watch: robot.advance(request.duration, watch)
    )


@router.get("/head", responses=responses(502, 504))
def get_head(coordinator: CoordinatorDep) -> HeadDescription:
    """Where the head points, and how far it can turn."""
    head = coordinator.control.head
    (pan_lower, pan_upper), (tilt_lower, tilt_upper) = head.limits
    return HeadDescription(
        **_head_info(head.state()).model_dump(),
        pan_lower=pan_lower,
        pan_upper=pan_upper,
        tilt_lower=tilt_lower,
        tilt_upper=tilt_upper,
        step=head.step,
        speed=head.speed,
    )


@router.post("/head/moves", status_code=202, response_model=JobView, responses=_MOVES)
def turn_head(control_lease: ControlLease, request: TurnHead, coordinator: CoordinatorDep, once: OnceDep) -> Response:
    """Turns the head; it rounds to its own steps."""

    def finish(job: Job, reached: HeadState) -> None:
        job.finish(_head_info(reached))

    def work() -> tuple[JobView, str]:
        job = coordinator.control.turn_head(control_lease, request.pan, request.tilt, coordinator.jobs, finish)
        return job.view(), f"/v1/jobs/{job.id}"

    return once.reply(work, 202)


def _move(coordinator: Coordinator, once: Once, lease: str, action: str, motion: Move) -> Response:
    def finish(job: Job, reached: RobotState) -> None:
        job.finish(robot_info(reached))

    def work() -> tuple[JobView, str]:
        job = coordinator.control.move(lease, action, coordinator.jobs, motion, finish)
        return job.view(), f"/v1/jobs/{job.id}"

    return once.reply(work, 202)


def _pace(pace: PaceRequest) -> Pace:
    return Pace(pace.speed, pace.acceleration)


def _head_info(state: HeadState) -> HeadInfo:
    return HeadInfo(pan=state.pan, tilt=state.tilt, moving=state.moving, world_time=state.world_time)
