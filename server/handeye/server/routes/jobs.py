"""Jobs: state, result, cancel, events as they happen, and the pictures of their looks."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Path, Response
from fastapi.sse import EventSourceResponse, ServerSentEvent

from handeye.server.job import Job
from handeye.server.problem import NotFound
from handeye.server.problem_responses import picture_responses, responses
from handeye.server.results import JobView
from handeye.server.routes import CoordinatorDep, Cursor, Limit, cursor_at, place
from handeye.server.schemas.tasks import JobPage
from handeye.server.store import jobs as stored

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])

LastEventId = Annotated[
    int, Header(alias="Last-Event-ID", ge=0, description="The number of the last event that the caller knows.")
]
LookNumber = Annotated[int, Path(ge=0, lt=2**31)]

_EVENT_PERIOD = 0.05  # s between two looks whether something happened: no thread waits for each who listens


def _job(job_id: str, coordinator: CoordinatorDep) -> Job:
    return coordinator.jobs.get(job_id)


JobDep = Annotated[Job, Depends(_job)]


@router.get("", responses=responses())
def list_jobs(coordinator: CoordinatorDep, limit: Limit = 100, cursor: Cursor = None) -> JobPage:
    """The jobs, newest first."""
    begin = place(cursor, int)
    views, following = coordinator.jobs.page(begin[0] if begin else None, limit)
    return JobPage(jobs=tuple(views), next=None if following is None else cursor_at([following]))


@router.get("/{job_id}", responses=responses(404))
def get_job(job: JobDep) -> JobView:
    """The job as it is now."""
    return job.view()


@router.post("/{job_id}/cancel", status_code=202, responses=responses(404))
async def cancel_job(job_id: str, coordinator: CoordinatorDep) -> JobView:
    """Brakes the motion under way, stops the arm and ends the job; does nothing to a job that has ended."""
    job = coordinator.jobs.under_way(job_id)  # no thread is needed, and none need be free
    if job is None:
        job = await asyncio.to_thread(coordinator.jobs.get, job_id)
    job.cancel()
    return job.view()


@router.get("/{job_id}/events", response_class=EventSourceResponse, responses=responses(404))
async def job_events(job: JobDep, last_event_id: LastEventId = 0) -> AsyncIterator[ServerSentEvent]:
    """Server-sent events from the job's first on, or from after Last-Event-ID; the stream ends with the job.

    Events: `state` (data: the job), `progress`; of runs `subtask`, `look`, `waypoint`, `not_seen`, `again`, `stop`; of
    reaches, gazes and pursuits `look`; of collecting `posture`.
    """
    seen = last_event_id
    while True:
        ended = job.ended  # before the events are asked for: what comes after the end is none
        for event in job.events(seen, 0.0):
            seen = event.number
            yield ServerSentEvent(data=event.data, event=event.kind, id=str(event.number))
        if ended:
            return
        await asyncio.sleep(_EVENT_PERIOD)


@router.get(
    "/{job_id}/looks/{number}.jpg",
    response_class=Response,
    responses=picture_responses(404),
)
def look_picture(job: JobDep, number: LookNumber, coordinator: CoordinatorDep) -> Response:
    """The left and the right picture of a look (from 0), the object marked red and the hand green."""
    with coordinator.store.read() as connection:
        picture = stored.picture(connection, job.id, number)
    if picture is None:
        raise NotFound(
            f"Job '{job.id}' has no picture of look {number}: pictures of the newest "
            f"{coordinator.settings.pictures_kept} runs are kept."
        )
    return Response(picture, media_type="image/jpeg")
