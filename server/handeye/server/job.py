"""A job: one piece of long work, with its events, its result and what became of it, which is in the store."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Literal

import structlog
from pydantic import BaseModel
from sqlalchemy import Connection

from handeye.server.problem import error_code, error_sentence
from handeye.server.results import JobError, JobState, JobView
from handeye.server.store import Store
from handeye.server.store import jobs as stored
from handeye.server.store.rows import dumps, loads, now

log = structlog.get_logger(__name__)

Kind = Literal["run", "train", "motion", "reach", "gaze", "pursuit", "collect"]

_UNFORESEEN = ("internal", "store_failed")  # the log has what the job does not tell

FINAL = frozenset({JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED, JobState.INTERRUPTED})


class JobCancelled(Exception):
    """Somebody asked the job to end."""


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
        self,
        kind: str,
        data: dict[str, Any],
        result: BaseModel | None,
        also: Callable[[Connection], object] | None = None,
    ) -> None:
        """Adds an event and replaces the result by the newer one; both are durable before anybody hears of them.

        Without a result it stays as it was. `also` writes down what belongs to them, in the same transaction.
        """
        content = self._result if result is None else result.model_dump(mode="json")
        number = self._newest + 1
        # Not under the lock: who holds the store asks jobs whether they have ended.
        with self._store.write() as connection:
            if result is not None:
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

    @property
    def cancelled(self) -> bool:
        """Somebody has asked it to end."""
        return self._cancelled.is_set()

    def check(self) -> None:
        """Raises `JobCancelled` once somebody has asked for it; the work calls this often."""
        if self.cancelled:
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
        """One thread at a time does, the job's own or one that writes for it: the numbers follow each other."""
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
            log.warning("job failed", job=self.id, code=code, error=str(error), exc_info=code in _UNFORESEEN)
            self.enter(JobState.FAILED, JobError(code=code, message=error_sentence(error)))
        else:
            self.enter(JobState.SUCCEEDED)
        log.info("job ended", job=self.id, state=self.view().state, seconds=round(time.monotonic() - started, 3))
