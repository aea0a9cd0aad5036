"""Jobs: what they did, their events as they happen, and waiting for their end."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing, suppress
from typing import TypeVar

import httpx2

from handeye.client._async.calls import AsyncCalls, part
from handeye.client._foreign import parse_object, readable
from handeye.client._job_models import Job, JobEvent, Jobs, OnEvent
from handeye.client._retries import Deadline
from handeye.client._waiting import async_sleep
from handeye.client.errors import HandeyeError, Silent, TimedOut, UnexpectedAnswer, Unreachable

J = TypeVar("J", bound=Job)

STREAM_SILENCE = 20.0
"""s; the coordinator pings an idle event stream every 15 s."""
_BREAKS = 3
"""An event stream that breaks so often in a row, while the coordinator answers otherwise, is given up."""
_AGAIN = 0.1
"""s before an event stream that brought nothing is opened again."""
_CANCEL_TIMEOUT = 5.0
"""s for cancelling a job that is left: who pressed Ctrl-C does not want to wait for a coordinator that is gone."""
_LAST_LOOK = 1.0
"""s to ask for the job when its time is over: it may just have ended."""


def ignore(_event: JobEvent) -> None:
    """The listener of a job to whose events nobody listens."""


def no_check() -> None:
    """What a wait looks after that has nothing to look after."""


class AsyncJobCalls(AsyncCalls):
    """The part of the client for /v1/jobs."""

    async def jobs(self, limit: int = 100) -> tuple[Job, ...]:
        """The newest jobs, newest first, at most `limit` of them."""
        found: list[Job] = []
        async with aclosing(self._pages(Jobs, "/v1/jobs", {"limit": str(max(1, min(limit, 1000)))})) as pages:
            async for page in pages:
                found.extend(page.jobs)
                if len(found) >= limit:
                    break
        return tuple(found[:limit])

    async def job(self, job_id: str) -> Job:
        """A job as it is now: a `RunJob`, `TrainJob` or `MotionJob`."""
        return await self._get(Job, f"/v1/jobs/{part(job_id)}")

    async def cancel_job(self, job_id: str) -> Job:
        """Asks a job to end; the motion under way is braked."""
        return await self._cancel(job_id, timeout=None)

    async def _cancel(self, job_id: str, timeout: float | None) -> Job:
        # To be asked again is nothing to a job that was cancelled already.
        return await self._post(Job, f"/v1/jobs/{part(job_id)}/cancel", retries=self._retries, timeout=timeout)

    async def events(self, job_id: str, after: int = 0, silence: float = STREAM_SILENCE) -> AsyncGenerator[JobEvent]:
        """A job's events numbered above `after`, as they happen, until it ends.

        `Unreachable` when the stream breaks, `Silent` when nothing comes for `silence` s, not even a ping.
        """
        path, headers = f"/v1/jobs/{part(job_id)}/events", {"Last-Event-ID": str(after)}
        async with self._stream("GET", path, silence=silence, headers=headers) as response:
            async for event in httpx2.EventSource(response):
                with readable(self._url):
                    read = JobEvent(number=int(event.id), kind=event.event, data=parse_object(event.data))
                yield read

    async def follow(self, job_id: str, timeout: float, on_event: OnEvent = ignore) -> Job:
        """Waits until a job has ended and returns it, whatever its state; `TimedOut` after `timeout` s.

        A broken event stream is taken up again where it broke; `Unreachable` when the coordinator is gone.
        """
        return await self._follow(job_id, timeout, on_event)

    async def _follow(
        self,
        job_id: str,
        timeout: float,
        on_event: OnEvent,
        *,
        silence: float = STREAM_SILENCE,
        check: Callable[[], None] = no_check,
    ) -> Job:
        """As `follow`; `check` is called at least every `silence` s, and what it raises ends the wait."""
        deadline = Deadline(timeout)
        seen, breaks = 0, 0
        while not deadline.passed():
            check()
            before, complete = seen, False
            try:
                async with aclosing(self.events(job_id, seen, min(deadline.left(), silence))) as stream:
                    async for event in stream:
                        seen = event.number
                        on_event(event)
                        check()
                        if deadline.passed():
                            break
                    else:
                        complete = True
            except Silent:
                pass  # asking for the job tells whether the coordinator still lives
            except Unreachable:
                breaks = 1 if seen > before else breaks + 1
                if breaks > _BREAKS:
                    raise
            left = max(deadline.left(), _LAST_LOOK)
            job = await self._get(Job, f"/v1/jobs/{part(job_id)}", timeout=min(left, self._timeout))
            if job.ended and complete:
                return job
            if seen == before:
                await async_sleep(_AGAIN)
        raise TimedOut(f"Job {job_id} did not end within {timeout:g} s.")

    async def _see_through(
        self,
        job: J,
        timeout: float,
        on_event: OnEvent = ignore,
        *,
        silence: float = STREAM_SILENCE,
        check: Callable[[], None] = no_check,
    ) -> J:
        """The job when it has ended, failed ones too; it is cancelled when the wait ends early, for whatever reason."""
        try:
            ended = await self._follow(job.id, timeout, on_event, silence=silence, check=check)
        except BaseException:
            with suppress(HandeyeError):  # what made us leave is the error to report
                await self._cancel(job.id, timeout=_CANCEL_TIMEOUT)
            raise
        if not isinstance(ended, type(job)):
            raise UnexpectedAnswer(f"Job {job.id} of kind {job.kind!r} became one of kind {ended.kind!r}.")
        return ended
