"""Jobs: long work in threads of its own, outside the event loop, with events, cancel and a result.

Jobs are kept in memory: they do not survive a restart of the coordinator.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import structlog

from handeye.server.problem import Conflict, NotFound, error_code, error_sentence
from handeye.server.results import JobError, JobState, JobView, RunResult

log = structlog.get_logger(__name__)

FINAL = frozenset({JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED})


class JobCancelled(Exception):
    """Somebody asked the job to end."""


class JobBusy(Conflict):
    """Another job acts with the robot."""

    code = "busy"


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened in a job. `number` counts from 1; `data` is JSON."""

    number: int
    kind: str
    data: dict[str, Any]


class Job:
    """One piece of work and all that is known about it. Safe among threads."""

    def __init__(self, task: str, object_name: str) -> None:
        self.id = secrets.token_hex(8)
        self._task = task
        self._object = object_name
        self._state = JobState.QUEUED
        self._error: JobError | None = None
        self._result = RunResult(subtasks=())
        self._events: list[Event] = []
        self._changed = threading.Condition()
        self._cancelled = threading.Event()

    def view(self) -> JobView:
        """The job as it is now."""
        with self._changed:
            return self._view()

    def _view(self) -> JobView:
        return JobView(
            id=self.id,
            task=self._task,
            object=self._object,
            state=self._state,
            error=self._error,
            result=self._result,
        )

    def publish(self, kind: str, data: dict[str, Any], result: RunResult) -> None:
        """Adds an event and replaces the result by the newer one."""
        with self._changed:
            self._result = result
            self._append(kind, data)

    def cancel(self) -> None:
        """Asks the work to end; a motion under way is braked. Does nothing to a job that has ended."""
        self._cancelled.set()

    def check(self) -> None:
        """Raises `JobCancelled` once somebody has asked for it; the work calls this often."""
        if self._cancelled.is_set():
            raise JobCancelled("the job was cancelled")

    def events(self, after: int, timeout: float) -> tuple[Event, ...]:
        """The events numbered above `after`; waits up to `timeout` s for the first one unless the job has ended."""
        with self._changed:
            self._changed.wait_for(lambda: len(self._events) > after or self._state in FINAL, timeout)
            return tuple(self._events[max(after, 0) :])

    def wait(self, timeout: float) -> bool:
        """Waits until the job has ended; False when it has not within `timeout` s."""
        with self._changed:
            return self._changed.wait_for(lambda: self._state in FINAL, timeout)

    @property
    def ended(self) -> bool:
        """Succeeded, failed or cancelled."""
        with self._changed:
            return self._state in FINAL

    def _enter(self, state: JobState, error: JobError | None = None) -> None:
        with self._changed:
            self._state = state
            self._error = error
            self._append("state", self._view().model_dump(mode="json"))

    def _append(self, kind: str, data: dict[str, Any]) -> None:
        self._events.append(Event(len(self._events) + 1, kind, data))
        self._changed.notify_all()

    def run(self, work: Callable[[Job], None]) -> None:
        """Does `work` in the calling thread and ends in a final state, whatever happens."""
        started = time.monotonic()
        self._enter(JobState.RUNNING)
        try:
            work(self)
        except JobCancelled as error:
            self._enter(JobState.CANCELLED, JobError(code="cancelled", message=str(error)))
        except Exception as error:  # the one place where a job's errors end: every one becomes the job's own
            code = error_code(error)
            log.warning("job failed", job=self.id, code=code, error=str(error), exc_info=code == "internal")
            self._enter(JobState.FAILED, JobError(code=code, message=error_sentence(error)))
        else:
            self._enter(JobState.SUCCEEDED)
        log.info("job ended", job=self.id, state=self.view().state, seconds=round(time.monotonic() - started, 3))


class Jobs:
    """The jobs: at most one acts at a time; the newest `kept` can be asked for."""

    def __init__(self, kept: int = 200) -> None:
        self._kept = kept
        self._jobs: OrderedDict[str, Job] = OrderedDict()
        self._threads: dict[str, threading.Thread] = {}
        self._closed = False
        self._lock = threading.Lock()

    def start(self, task: str, object_name: str, work: Callable[[Job], None]) -> Job:
        """Starts `work` in a thread; `JobBusy` while another job has not ended."""
        job = Job(task, object_name)
        with self._lock:
            if self._closed:
                raise JobBusy("The coordinator is shutting down; it starts no more jobs.")
            if under_way := [other.id for other in self._jobs.values() if not other.ended]:
                raise JobBusy(
                    f"Job {under_way[0]} acts with the robot; wait for its end, or cancel it by "
                    f"POST /v1/jobs/{under_way[0]}/cancel."
                )
            self._jobs[job.id] = job
            while len(self._jobs) > self._kept:
                self._jobs.popitem(last=False)
            self._threads = {name: thread for name, thread in self._threads.items() if thread.is_alive()}
            thread = threading.Thread(target=job.run, args=(work,), name=f"job-{job.id}", daemon=True)
            self._threads[job.id] = thread
            thread.start()
        return job

    def get(self, job_id: str) -> Job:
        """The job of that id; `NotFound` when there is none."""
        with self._lock:
            job = self._jobs.get(job_id)
        if job is None:
            raise NotFound(
                f"There is no job '{job_id}'; the newest {self._kept} since the coordinator's start are kept."
            )
        return job

    def close(self, timeout: float = 4.0) -> None:
        """Cancels what is under way and waits for it; no job starts afterwards."""
        deadline = time.monotonic() + timeout
        with self._lock:
            self._closed = True
            jobs, threads = list(self._jobs.values()), dict(self._threads)
        for job in jobs:
            if not job.ended:
                job.cancel()
        for job_id, thread in threads.items():
            thread.join(max(0.0, deadline - time.monotonic()))
            if thread.is_alive():
                log.error("job did not end in time", job=job_id)
