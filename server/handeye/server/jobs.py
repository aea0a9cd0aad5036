"""Jobs: long work in threads of its own, outside the event loop, with events, cancel and a result.

What became of a job is in the store: it survives a restart, and a job that a restart cut off says so.
"""

from __future__ import annotations

import contextvars
import secrets
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Literal

import structlog
from pydantic import BaseModel
from sqlalchemy import Connection

from handeye.server.problem import Conflict, NotFound, error_code, error_sentence
from handeye.server.results import JobError, JobState, JobView
from handeye.server.store import Store
from handeye.server.store import jobs as stored
from handeye.server.store.rows import dumps, loads, now

log = structlog.get_logger(__name__)

Kind = Literal["run", "train", "motion", "reach", "gaze", "pursuit", "collect"]

FINAL = frozenset({JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED, JobState.INTERRUPTED})

_TURN_POLL = 0.1  # s between two looks whether a job that waits for its turn was cancelled


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

    def __init__(self, store: Store, row: Mapping[str, Any], events: list[Event]) -> None:
        """A job as its row in the store tells."""
        self.id: str = row["id"]
        self.kind: Kind = row["kind"]
        self.subject: str = row["subject"]
        self._store = store
        self._object: str | None = row["object"]
        self._state = JobState(row["state"])
        self._error = None if row["error"] is None else JobError.model_validate_json(row["error"])
        self._result: dict[str, Any] | None = None if row["result"] is None else loads(row["result"])
        self._times: dict[str, float | None] = {key: row[key] for key in ("created", "started", "ended")}
        self._progress: float | None = 1.0 if self._state is JobState.SUCCEEDED else None
        self._events = events
        self.durable = True
        """What became of it is in the store."""
        self._changed = threading.Condition()
        self._cancelled = threading.Event()

    def view(self) -> JobView:
        """The job as it is now."""
        with self._changed:
            times = {key: None if at is None else datetime.fromtimestamp(at, UTC) for key, at in self._times.items()}
            return JobView.model_validate(
                {
                    "id": self.id,
                    "kind": self.kind,
                    "subject": self.subject,
                    "object": self._object,
                    "state": self._state,
                    "progress": self._progress,
                    "error": self._error,
                    "result": self._result,
                    **times,
                }
            )

    def publish(
        self, kind: str, data: dict[str, Any], result: BaseModel, also: Callable[[Connection], object] | None = None
    ) -> None:
        """Adds an event and replaces the result by the newer one; both are durable before anybody hears of them.

        `also` writes down what belongs to them, in the same transaction.
        """
        content, number = result.model_dump(mode="json"), self._newest + 1
        # Not under the lock: who holds the store asks jobs whether they have ended.
        with self._store.write() as connection:
            stored.update(connection, self.id, result=dumps(content))
            stored.add_event(connection, self.id, number, kind, data)
            if also is not None:
                also(connection)
        with self._changed:
            self._result = content
            self._append(kind, data)

    def finish(self, result: BaseModel) -> None:
        """Sets the result; it becomes durable with the job's end."""
        with self._changed:
            self._result = result.model_dump(mode="json")

    def report(self, share: float) -> None:
        """Says how much is done, 0..1; whoever follows the job hears of it, the store does not."""
        share = min(max(share, 0.0), 1.0)
        with self._changed:
            if self._progress is None or share - self._progress >= 0.01 or share == 1.0 > self._progress:
                self._progress = share
                self._append("progress", {"progress": self._progress})

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
            self._changed.wait_for(lambda: self._newest > after or self._state in FINAL, timeout)
            if after > self._newest and self._state in FINAL:
                # The number of a progress that an earlier process told and nobody has any more.
                return tuple(self._events[-1:])
            return tuple(event for event in self._events if event.number > after)

    def wait(self, timeout: float) -> bool:
        """Waits until the job has ended; False when it has not within `timeout` s."""
        with self._changed:
            return self._changed.wait_for(lambda: self._state in FINAL, timeout)

    @property
    def ended(self) -> bool:
        """Nothing more will happen in it."""
        with self._changed:
            return self._state in FINAL

    @property
    def _newest(self) -> int:
        return self._events[-1].number if self._events else 0

    def enter(self, state: JobState, error: JobError | None = None) -> None:
        """Changes the state, durably unless the store fails: a job ends also then."""
        moment = "started" if state is JobState.RUNNING else "ended" if state in FINAL else "created"
        at, number = now(), self._newest + 1
        progress = self._progress if state not in FINAL else 1.0 if state is JobState.SUCCEEDED else None
        changed = {"state": state, "error": error, "progress": progress, moment: datetime.fromtimestamp(at, UTC)}
        view = self.view().model_copy(update=changed).model_dump(mode="json")
        try:
            with self._store.write() as connection:
                stored.update(
                    connection,
                    self.id,
                    state=state.value,
                    error=None if error is None else error.model_dump_json(),
                    result=None if self._result is None else dumps(self._result),
                    **{moment: at},
                )
                stored.add_event(connection, self.id, number, "state", view)
        except Exception:
            self.durable = False
            log.exception("a job's state could not be written to the store", job=self.id, state=state)
        else:
            self.durable = True
        with self._changed:
            self._state, self._error, self._progress = state, error, progress
            self._times[moment] = at
            self._append("state", view)

    def _append(self, kind: str, data: dict[str, Any]) -> None:
        """Only the job's own thread does: the numbers follow each other."""
        self._events.append(Event(self._newest + 1, kind, data))
        self._changed.notify_all()

    def run(self, work: Callable[[Job], None]) -> None:
        """Does `work` in the calling thread and ends in a final state, whatever happens."""
        started = time.monotonic()
        try:
            self.check()
            self.enter(JobState.RUNNING)
            work(self)
        except JobCancelled as error:
            self.enter(JobState.CANCELLED, JobError(code="cancelled", message=str(error)))
        except Exception as error:  # the one place where a job's errors end: every one becomes the job's own
            code = error_code(error)
            log.warning("job failed", job=self.id, code=code, error=str(error), exc_info=code == "internal")
            self.enter(JobState.FAILED, JobError(code=code, message=error_sentence(error)))
        else:
            self.enter(JobState.SUCCEEDED)
        log.info("job ended", job=self.id, state=self.view().state, seconds=round(time.monotonic() - started, 3))


class Jobs:
    """The jobs of a store: at most one acts with the robot at a time, the others take turns."""

    def __init__(self, store: Store, kept: int, on_end: Callable[[Job], None] = lambda _job: None) -> None:
        """The newest `kept` jobs can be asked for. Those that an earlier process left unfinished are interrupted."""
        self._store = store
        self._kept = kept
        self._on_end = on_end
        self._live: dict[str, tuple[Job, threading.Thread, bool]] = {}
        """Jobs under way, and those whose end could not be written down."""
        self._closed = False
        self._lock = threading.RLock()
        self._turn = threading.Semaphore(1)
        self.interrupt()

    def start(
        self, kind: Kind, subject: str, object_name: str | None, work: Callable[[Job], None], *, acts: bool
    ) -> Job:
        """Starts `work` in a thread once the transaction under way, if any, is committed.

        `JobBusy` when it acts with the robot while another job does.
        """
        name = secrets.token_hex(8)
        with self._store.write() as connection, self._lock:
            if self._closed:
                raise JobBusy("The coordinator is shutting down; it starts no more jobs.")
            if acts and (other := self.acting):
                raise self.busy(other)
            stored.prune(connection, self._kept - 1)
            stored.create(connection, name, kind, subject, object_name)
            job = self._load(name)
            context = contextvars.copy_context()  # the request's id goes with it, into the log
            thread = threading.Thread(
                target=context.run, args=(self._run, job, work, acts), name=f"job-{name}", daemon=True
            )

            def begin() -> None:
                with self._lock:
                    if not self._closed:
                        self._live[name] = (job, thread, acts)
                        thread.start()
                        return
                job.cancel()
                job.run(work)  # which ends it at once

            self._store.afterwards(begin)
        return job

    @property
    def acting(self) -> Job | None:
        """The job that acts with the robot now."""
        with self._lock:
            return next((job for job, _thread, acts in self._live.values() if acts and not job.ended), None)

    def busy(self, job: Job) -> JobBusy:
        """Why nobody else can act with the robot while this job does."""
        return JobBusy(
            f"Job {job.id} acts with the robot; wait for its end, or cancel it by POST /v1/jobs/{job.id}/cancel."
        )

    def require_none(self) -> None:
        """`JobBusy` while any job is under way."""
        with self._lock:
            for job_id in self._live:
                raise JobBusy(
                    f"Job {job_id} is under way; wait for its end, or cancel it by POST /v1/jobs/{job_id}/cancel."
                )

    def under_way(self, job_id: str) -> Job | None:
        """The job of that id if it is under way, without asking the store."""
        live = self._live.get(job_id)
        return None if live is None else live[0]

    def get(self, job_id: str) -> Job:
        """The job of that id; `NotFound` when there is none."""
        job = self.under_way(job_id) or self._load(job_id)
        if job.ended or self.under_way(job_id) is job:
            return job
        # It has just ended, or its transaction is committed and it is about to start: before the next write.
        with self._store.write():
            return self.under_way(job_id) or self._load(job_id)

    def page(self, before: int | None, limit: int) -> tuple[list[JobView], int | None]:
        """At most `limit` jobs numbered below `before`, newest first, and what to ask for next; None at the end."""
        with self._store.read() as connection:
            rows = stored.page(connection, before, limit + 1)
        shown = rows[:limit]
        views = [(self.under_way(row["id"]) or Job(self._store, dict(row), [])).view() for row in shown]
        return views, shown[-1]["number"] if len(rows) > limit else None

    def close(self, timeout: float = 4.0) -> None:
        """Cancels what is under way and waits for it; no job starts afterwards."""
        deadline = time.monotonic() + timeout
        with self._lock:
            self._closed = True
            live = list(self._live.values())
        for job, _thread, _acts in live:
            job.cancel()
        for job, thread, _acts in live:
            thread.join(max(0.0, deadline - time.monotonic()))
            if thread.is_alive():
                log.error("job did not end in time", job=job.id)

    def _run(self, job: Job, work: Callable[[Job], None], acts: bool) -> None:
        try:
            if acts:
                job.run(work)
                return
            while not self._turn.acquire(timeout=_TURN_POLL):
                if job._cancelled.is_set():
                    job.run(work)  # which ends it at once
                    return
            try:
                job.run(work)
            finally:
                self._turn.release()
        finally:
            if job.durable:
                with self._lock:
                    del self._live[job.id]
            self._on_end(job)

    def _load(self, job_id: str) -> Job:
        with self._store.read() as connection:
            row = stored.read(connection, job_id)
            if row is None:
                raise NotFound(f"There is no job '{job_id}'; the newest {self._kept} are kept.")
            events = [
                Event(each["number"], each["kind"], loads(each["data"])) for each in stored.events(connection, job_id)
            ]
        return Job(self._store, row, events)

    def interrupt(self) -> None:
        """Says of the jobs that an earlier process did not end, or that a backup has so, that they were interrupted."""
        with self._store.read() as connection:
            names = [row["id"] for row in stored.unfinished(connection)]
        for name in names:
            if self.under_way(name):
                continue
            message = (
                "The coordinator ended while the job was under way; the robot stopped by itself. The result has what "
                "was done until then."
            )
            self._load(name).enter(JobState.INTERRUPTED, JobError(code="interrupted", message=message))
            log.warning("an earlier process left a job unfinished", job=name)
