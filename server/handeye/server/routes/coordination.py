"""Hand and eye as a whole: reaching for what is seen, turning the head to it, and collecting samples for both."""

from __future__ import annotations

import numpy as np
from anyio import to_thread
from fastapi import APIRouter, Response

from handeye.server.collecting.viewing import learn_view
from handeye.server.job import Job
from handeye.server.problem_responses import responses
from handeye.server.results import CollectResult, JobView
from handeye.server.routes import CameraLaneDep, CoordinatorDep
from handeye.server.routes.once import OnceDep
from handeye.server.schemas.coordination import (
    FixationRequest,
    GazeRequest,
    GridViewRequest,
    LookInfo,
    LookRequest,
    PosturesRequest,
    PursuitRequest,
    ReachRequest,
)

router = APIRouter(prefix="/v1", tags=["coordination"])


@router.post("/looks", responses=responses(404, 502, 504))
async def look(request: LookRequest, coordinator: CoordinatorDep, lane: CameraLaneDep) -> LookInfo:
    """Where an object, or the hand, is seen now; 422 `not_seen` says what is missing."""
    return await lane.run(lambda: coordinator.coordination.look(request.object, request.not_older_than))


@router.post("/reaches", status_code=202, response_model=JobView, responses=responses(404, 409))
def reach(request: ReachRequest, coordinator: CoordinatorDep, once: OnceDep) -> Response:
    """Starts a job that brings the hand to an object or to a point, by CSS, CAS and AJS, looking again and again."""
    return once.reply(lambda: _accepted(coordinator.coordination.reach(request)), 202)


@router.post("/gazes", status_code=202, response_model=JobView, responses=responses(404, 409))
def gaze(request: GazeRequest, coordinator: CoordinatorDep, once: OnceDep) -> Response:
    """Starts a job that turns the head, by SCS, until an object or the hand is in the middle of the left picture."""
    return once.reply(lambda: _accepted(coordinator.coordination.gaze(request.object)), 202)


@router.post("/pursuits", status_code=202, response_model=JobView, responses=responses(404, 409))
def pursue(request: PursuitRequest, coordinator: CoordinatorDep, once: OnceDep) -> Response:
    """Starts a job in which the head follows an object that moves, by SCS, for a given time or until it is lost."""
    return once.reply(lambda: _accepted(coordinator.coordination.pursue(request.object, request.duration)), 202)


@router.post("/collect/postures", status_code=202, response_model=JobView, responses=responses(404, 409))
def collect_postures(request: PosturesRequest, coordinator: CoordinatorDep, once: OnceDep) -> Response:
    """Starts a job in which the arm babbles: AJS, CAS or IJS learn from where its hand comes.

    CAS needs CSS and SCS to be taught before.
    """
    return once.reply(lambda: _accepted(coordinator.coordination.collect_postures(request)), 202)


@router.post("/collect/fixations", status_code=202, response_model=JobView, responses=responses(404, 409))
def collect_fixation(request: FixationRequest, coordinator: CoordinatorDep, once: OnceDep) -> Response:
    """Starts a job that turns the head until a resting object is in the middle of the left picture: SCS learns from it.

    Turn the head before, so that the object is anywhere else in view.
    """
    return once.reply(lambda: _accepted(coordinator.coordination.collect_fixation(request.object, request.keep)), 202)


@router.post("/collect/grid-views", status_code=201, response_model=CollectResult, responses=responses(409, 502, 504))
async def collect_grid_view(
    request: GridViewRequest, coordinator: CoordinatorDep, lane: CameraLaneDep, once: OnceDep
) -> Response:
    """Looks at a grid target that is held at a known place: CSS learns from it.

    In lockstep, let the time pass first that the cameras need.
    """
    if (before := await to_thread.run_sync(once.known)) is not None:
        return before
    points = np.array(request.points)
    seen = await lane.run(lambda: coordinator.coordination.see_grid(points, request.not_older_than))
    return await to_thread.run_sync(
        once.reply, lambda: (learn_view(coordinator.modules, seen, points, request.every), None)
    )


def _accepted(job: Job) -> tuple[JobView, str]:
    return job.view(), f"/v1/jobs/{job.id}"
