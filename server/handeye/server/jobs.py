"""Jobs: long work in threads of its own, outside the event loop, one at a time where it acts with the robot.

What became of a job is in the store: it survives a restart, and a job that a restart cut off says so.
"""

from __future__ import annotations

import contextvars
import secrets
import threading
import time
from collections.abc import Callable

import structlog

from handeye.server.job import Event, Job, Kind
from handeye.server.problem import Conflict, NotFound
from handeye.server.results import JobError, JobState, JobView
from handeye.server.store import Store
from handeye.server.store import jobs as stored
from handeye.server.store.rows import loads

log = structlog.get_logger(__name__)

_TURN_POLL = 0.1  # s between two looks whether a job that waits for its turn was cancelled


class JobBusy(Conflict):
    """Another job acts with the robot."""

    code = "busy"


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
                        try:
                            thread.start()
                        except RuntimeError:  # there are too many threads
                            del self._live[name]
                            log.exception("a job's thread could not be started", job=name)
                        else:
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
            for job, _thread, _acts in self._live.values():
                if not job.ended:
                    raise JobBusy(
                        f"Job {job.id} is under way; wait for its end, or cancel it by POST /v1/jobs/{job.id}/cancel."
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
                if job.cancelled:
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
