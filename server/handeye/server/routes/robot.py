"""The robot: its state, stop and reset."""

from __future__ import annotations

import math
from functools import partial

from fastapi import APIRouter

from handeye.robot_bridge.driver import RobotState
from handeye.server.problem_responses import responses
from handeye.server.results import RobotInfo
from handeye.server.routes import CoordinatorDep, StopLaneDep
from handeye.server.schemas.robot import StopRequest

router = APIRouter(prefix="/v1/robot", tags=["robot"])

_UNASKED = StopRequest()


@router.get("", responses=responses(502, 504))
def robot_state(coordinator: CoordinatorDep) -> RobotInfo:
    """What the robot's own sensors say."""
    return robot_info(coordinator.robot.state())


@router.post("/stop", responses=responses(502, 504))
async def stop_robot(coordinator: CoordinatorDep, lane: StopLaneDep, request: StopRequest = _UNASKED) -> RobotInfo:
    """Brakes a motion under way, latches the software stop and cancels the job that acts. Not safety-rated."""
    return robot_info(await lane.run(partial(coordinator.stop, request.reason)))


@router.post("/reset", responses=responses(409, 502, 504))
def reset_robot(coordinator: CoordinatorDep) -> RobotInfo:
    """Clears the software stop; the next move is ramped. Refused until the job that acted has ended."""
    return robot_info(coordinator.reset())


def robot_info(state: RobotState) -> RobotInfo:
    """A state of the robot as callers see it."""
    return RobotInfo(
        world_time=state.world_time,
        joints=tuple(state.joints.tolist()),
        velocities=tuple(state.velocities.tolist()),
        point=tuple(state.point.tolist()),
        gripper_opening=state.gripper_opening,
        moving=state.moving,
        stopped=state.stopped,
        still_since=state.still_since if math.isfinite(state.still_since) else None,
        lease_holder=state.lease_holder,
    )
