"""Demonstrations: begin, observe, mark gripper actions, finish, judge, delete."""

from __future__ import annotations

from datetime import UTC, datetime
from functools import partial

from anyio import to_thread
from fastapi import APIRouter, Response

from handeye.modules.spaces import ImagePoint
from handeye.server.demonstration import Demonstration, Observation, Subtask
from handeye.server.problem_responses import responses
from handeye.server.routes import CameraLaneDep, CoordinatorDep, Cursor, Limit, cursor_at, place
from handeye.server.routes.once import OnceDep
from handeye.server.schemas.demonstrations import (
    ActionRequest,
    DemonstrationInfo,
    DemonstrationPage,
    DemonstrationRequest,
    ObservationInfo,
    ObservationList,
    ObservationRequest,
    OutcomeRequest,
    SubtaskInfo,
    WaypointRequest,
)

router = APIRouter(prefix="/v1/demonstrations", tags=["demonstrations"])


@router.get("", responses=responses())
def list_demonstrations(coordinator: CoordinatorDep, limit: Limit = 100, cursor: Cursor = None) -> DemonstrationPage:
    """The demonstrations, in the order they were begun."""
    begin = place(cursor, (int, float), str)
    found = coordinator.demonstrations.page((float(begin[0]), begin[1]) if begin else None, limit + 1)
    shown = found[:limit]
    following = cursor_at([shown[-1].created, shown[-1].id]) if len(found) > limit else None
    return DemonstrationPage(demonstrations=tuple(map(_info, shown)), next=following)


@router.post("", status_code=201, response_model=DemonstrationInfo, responses=responses(404, 409))
def begin_demonstration(request: DemonstrationRequest, coordinator: CoordinatorDep, once: OnceDep) -> Response:
    """Begins to record; the object must have been learned."""

    def work() -> tuple[DemonstrationInfo, str]:
        coordinator.objects.require(request.object)
        demonstration = coordinator.demonstrations.begin(request.task, request.object)
        return _info(demonstration), f"/v1/demonstrations/{demonstration.id}"

    return once.reply(work)


@router.get("/{demonstration_id}", responses=responses(404))
def get_demonstration(demonstration_id: str, coordinator: CoordinatorDep) -> DemonstrationInfo:
    """A demonstration so far."""
    return _info(coordinator.demonstrations.get(demonstration_id))


@router.patch("/{demonstration_id}", responses=responses(404))
def judge_demonstration(
    demonstration_id: str, request: OutcomeRequest, coordinator: CoordinatorDep
) -> DemonstrationInfo:
    """Says whether it was a success; failures are not trained from."""
    return _info(coordinator.demonstrations.judge(demonstration_id, request.outcome))


@router.delete("/{demonstration_id}", status_code=204, responses=responses(404))
def delete_demonstration(demonstration_id: str, coordinator: CoordinatorDep) -> None:
    """Deletes a demonstration, and its samples from every module: the next query does not know them."""
    coordinator.untrain(demonstration_id)


@router.get("/{demonstration_id}/observations", responses=responses(404))
def list_observations(demonstration_id: str, coordinator: CoordinatorDep) -> ObservationList:
    """What was observed in a demonstration, in order."""
    demonstration = coordinator.demonstrations.get(demonstration_id)
    return ObservationList(observations=tuple(map(_observation, demonstration.observations)))


@router.post(
    "/{demonstration_id}/observations",
    status_code=201,
    response_model=ObservationInfo,
    responses=responses(404, 409, 502, 504),
)
async def add_observation(
    demonstration_id: str,
    request: ObservationRequest,
    coordinator: CoordinatorDep,
    lane: CameraLaneDep,
    once: OnceDep,
) -> Response:
    """Grabs a stereo pair that shows the arm at rest, recognises object and hand, and reads the joints.

    An object that is not recognised can be marked by a person instead.
    """
    if (before := await to_thread.run_sync(once.known)) is not None:
        return before
    subtask, towards = request.subtask, request.object
    marked = None if request.object_at is None else ImagePoint(*request.object_at)
    look = partial(coordinator.look, demonstration_id, subtask, towards, goal=request.goal, object_at=marked)
    seen = await lane.run(look)

    def work() -> tuple[ObservationInfo, None]:
        observation = coordinator.record(demonstration_id, subtask, towards, seen, goal=request.goal, key=request.key)
        return _observation(observation), None

    return await to_thread.run_sync(once.reply, work)


@router.post(
    "/{demonstration_id}/waypoints",
    status_code=201,
    response_model=ObservationInfo,
    responses=responses(404, 409, 502, 504),
)
def add_waypoint(
    demonstration_id: str, request: WaypointRequest, coordinator: CoordinatorDep, once: OnceDep
) -> Response:
    """Reads the joints, with the arm at rest, and does not look: a point of the way that goes on from the goal."""
    return once.reply(lambda: (_observation(coordinator.pass_by(demonstration_id, request.subtask)), None))


@router.post(
    "/{demonstration_id}/actions", status_code=201, response_model=DemonstrationInfo, responses=responses(404, 409)
)
def add_action(demonstration_id: str, request: ActionRequest, coordinator: CoordinatorDep, once: OnceDep) -> Response:
    """Marks what the person did with the gripper at the end of a subtask."""
    return once.reply(
        lambda: (_info(coordinator.demonstrations.act(demonstration_id, request.subtask, request.action)), None)
    )


@router.post("/{demonstration_id}/finish", response_model=DemonstrationInfo, responses=responses(404, 409))
def finish_demonstration(demonstration_id: str, coordinator: CoordinatorDep, once: OnceDep) -> Response:
    """Checks that every subtask has its goal and closes the demonstration for training."""
    return once.reply(lambda: (_info(coordinator.demonstrations.finish(demonstration_id)), None), 200)


def _info(demonstration: Demonstration) -> DemonstrationInfo:
    return DemonstrationInfo(
        id=demonstration.id,
        task=demonstration.task,
        object=demonstration.object,
        state="finished" if demonstration.finished else "recording",
        outcome=demonstration.outcome,
        created=datetime.fromtimestamp(demonstration.created, UTC),
        observations=len(demonstration.observations),
        subtasks=tuple(map(subtask_info, demonstration.subtasks)),
    )


def subtask_info(subtask: Subtask) -> SubtaskInfo:
    """A subtask as it is shown."""
    return SubtaskInfo(name=subtask.name, action=subtask.action, object=subtask.object, way=subtask.way)


def _observation(observation: Observation) -> ObservationInfo:
    found = observation.found
    return ObservationInfo(
        number=observation.number,
        subtask=observation.subtask,
        towards=observation.object,
        goal=observation.goal,
        key=observation.key,
        world_time=observation.world_time,
        object=_place(found.object) if found else None,
        hand=_place(found.hand) if found else None,
        joints=tuple(observation.joints.tolist()),
        seconds=observation.seconds,
    )


def _place(point: ImagePoint) -> tuple[float, float, float]:
    return point.row, point.column, point.disparity
