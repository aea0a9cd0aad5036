"""Jobs: state, result, cancel, events as they happen, and the pictures of their looks."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Response
from fastapi.sse import EventSourceResponse, ServerSentEvent

from handeye.server.jobs import Job
from handeye.server.problem import NotFound, picture_responses, responses
from handeye.server.results import JobView
from handeye.server.routes import CoordinatorDep

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])

_EVENT_WAIT = 1.0  # s; bounds how long a thread outlives a caller who has gone


async def _job(job_id: str, coordinator: CoordinatorDep) -> Job:
    return coordinator.jobs.get(job_id)


JobDep = Annotated[Job, Depends(_job)]


@router.get("/{job_id}", responses=responses(404))
def get_job(job: JobDep) -> JobView:
    """The job as it is now."""
    return job.view()


@router.post("/{job_id}/cancel", status_code=202, responses=responses(404))
async def cancel_job(job: JobDep) -> JobView:
    """Brakes the motion under way, stops the arm and ends the job; does nothing to a job that has ended."""
    job.cancel()  # only takes a note: no thread is needed, and none need be free
    return job.view()


@router.get("/{job_id}/events", response_class=EventSourceResponse, responses=responses(404))
async def job_events(job: JobDep, last_event_id: Annotated[int, Header(ge=0)] = 0) -> AsyncIterator[ServerSentEvent]:
    """Server-sent events from the job's first on, or from after Last-Event-ID; the stream ends with the job.

    Events: `state` (data: the job), `subtask`, `look`, `not_seen`, `stop`.
    """
    seen = last_event_id
    while True:
        ended = job.ended  # before the events are asked for: what comes after the end is none
        for event in await asyncio.to_thread(job.events, seen, _EVENT_WAIT):
            seen = event.number
            yield ServerSentEvent(data=event.data, event=event.kind, id=str(event.number))
        if ended:
            return


@router.get(
    "/{job_id}/looks/{number}.jpg",
    response_class=Response,
    responses=picture_responses(404),
)
def look_picture(job: JobDep, number: int, coordinator: CoordinatorDep) -> Response:
    """The left and the right picture of a look (from 0), the object marked red and the hand green."""
    picture = coordinator.pictures.get(job.id, number)
    if picture is None:
        raise NotFound(
            f"Job '{job.id}' has no picture of look {number}: pictures of the newest "
            f"{coordinator.settings.pictures_kept} runs are kept."
        )
    return Response(picture, media_type="image/jpeg")
