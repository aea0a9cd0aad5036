"""Demonstrations: begin, observe, mark gripper actions, finish."""

from __future__ import annotations

from functools import partial

from fastapi import APIRouter, Response

from handeye.server.demonstrations import Demonstration, Observation
from handeye.server.problem import responses
from handeye.server.routes import CameraLaneDep, CoordinatorDep
from handeye.server.schemas import (
    ActionRequest,
    DemonstrationInfo,
    DemonstrationList,
    DemonstrationRequest,
    ObservationInfo,
    ObservationRequest,
    SubtaskInfo,
)

router = APIRouter(prefix="/v1/demonstrations", tags=["demonstrations"])


@router.get("", responses=responses())
def list_demonstrations(coordinator: CoordinatorDep) -> DemonstrationList:
    """The demonstrations, in the order they were begun."""
    return DemonstrationList(demonstrations=tuple(_info(d) for d in coordinator.demonstrations.all()))


@router.post("", status_code=201, responses=responses(404))
def begin_demonstration(
    request: DemonstrationRequest, coordinator: CoordinatorDep, response: Response
) -> DemonstrationInfo:
    """Begins to record; the object must have been learned."""
    coordinator.objects.require(request.object)
    demonstration = coordinator.demonstrations.begin(request.task, request.object)
    response.headers["Location"] = f"/v1/demonstrations/{demonstration.id}"
    return _info(demonstration)


@router.get("/{demonstration_id}", responses=responses(404))
def get_demonstration(demonstration_id: str, coordinator: CoordinatorDep) -> DemonstrationInfo:
    """A demonstration so far."""
    return _info(coordinator.demonstrations.get(demonstration_id))


@router.post("/{demonstration_id}/observations", status_code=201, responses=responses(404, 409, 503, 504))
async def add_observation(
    demonstration_id: str, request: ObservationRequest, coordinator: CoordinatorDep, lane: CameraLaneDep
) -> ObservationInfo:
    """Grabs a stereo pair that shows the arm at rest, recognises object and hand, and reads the joints."""
    observe = partial(coordinator.observe, demonstration_id, request.subtask, goal=request.goal, key=request.key)
    return _observation(await lane.run(observe))


@router.post("/{demonstration_id}/actions", status_code=201, responses=responses(404, 409))
def add_action(demonstration_id: str, request: ActionRequest, coordinator: CoordinatorDep) -> DemonstrationInfo:
    """Marks what the person did with the gripper at the end of a subtask."""
    return _info(coordinator.demonstrations.act(demonstration_id, request.subtask, request.action))


@router.post("/{demonstration_id}/finish", responses=responses(404, 409))
def finish_demonstration(demonstration_id: str, coordinator: CoordinatorDep) -> DemonstrationInfo:
    """Checks that every subtask has its goal and closes the demonstration for training."""
    return _info(coordinator.demonstrations.finish(demonstration_id))


def _info(demonstration: Demonstration) -> DemonstrationInfo:
    return DemonstrationInfo(
        id=demonstration.id,
        task=demonstration.task,
        object=demonstration.object,
        state="finished" if demonstration.finished else "recording",
        observations=len(demonstration.observations),
        subtasks=tuple(SubtaskInfo(name=s.name, action=s.action) for s in demonstration.subtasks),
    )


def _observation(observation: Observation) -> ObservationInfo:
    found = observation.found
    return ObservationInfo(
        number=observation.number,
        subtask=observation.subtask,
        goal=observation.goal,
        key=observation.key,
        world_time=observation.world_time,
        object=(found.object.row, found.object.column, found.object.disparity),
        hand=(found.hand.row, found.hand.column, found.hand.disparity),
        joints=tuple(observation.joints.tolist()),
    )
