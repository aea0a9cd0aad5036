"""Jobs in the store: what became of them, what happened in them, and the pictures of their looks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqlalchemy import Connection, RowMapping, delete, func, select

from handeye.server.store import counters
from handeye.server.store.rows import add, change, dumps, find, now
from handeye.server.store.tables import job_events, jobs, look_pictures

_PICTURED = ("run", "reach")
_UNFINISHED = ("queued", "running")


def create(connection: Connection, name: str, kind: str, subject: str, object_name: str | None) -> None:
    """A job that waits to be begun."""
    add(
        connection,
        jobs,
        id=name,
        number=counters.take(connection, "jobs"),
        kind=kind,
        subject=subject,
        object=object_name,
        state="queued",
        error=None,
        result=None,
        created=now(),
        started=None,
        ended=None,
    )


def update(connection: Connection, name: str, **changes: Any) -> None:
    """Changes columns of a job; `error` and `result` are JSON text."""
    change(connection, jobs, name, **changes)


def read(connection: Connection, name: str) -> Mapping[str, Any] | None:
    """A job's row; None when there is none."""
    return find(connection, jobs, name)


def page(connection: Connection, before: int | None, limit: int) -> list[RowMapping]:
    """Rows of at most `limit` jobs with numbers below `before`, newest first."""
    wanted = select(jobs).order_by(jobs.c.number.desc()).limit(limit)
    if before is not None:
        wanted = wanted.where(jobs.c.number < before)
    return list(connection.execute(wanted).mappings())


def unfinished(connection: Connection) -> list[RowMapping]:
    """Rows of the jobs that have not ended."""
    return list(connection.execute(select(jobs).where(jobs.c.state.in_(_UNFINISHED))).mappings())


def add_event(connection: Connection, name: str, number: int, kind: str, data: Mapping[str, Any]) -> None:
    """Writes down something that happened in a job."""
    add(connection, job_events, job=name, number=number, kind=kind, data=dumps(data))


def events(connection: Connection, name: str) -> list[RowMapping]:
    """Rows of what happened in a job, in order."""
    return list(
        connection.execute(select(job_events).where(job_events.c.job == name).order_by(job_events.c.number)).mappings()
    )


def prune(connection: Connection, kept: int) -> None:
    """Forgets all but the newest `kept` jobs; those under way are not forgotten."""
    newest = connection.execute(select(func.max(jobs.c.number))).scalar() or 0
    old = (jobs.c.number <= newest - kept) & jobs.c.state.not_in(_UNFINISHED)
    connection.execute(delete(jobs).where(old))


def add_picture(connection: Connection, name: str, number: int, image: bytes, runs_kept: int) -> None:
    """Keeps a job's picture, numbered from 0; the newest `runs_kept` jobs with looks keep theirs."""
    add(connection, look_pictures, job=name, number=number, image=image)
    if number == 0:
        pictured = select(jobs.c.id).where(jobs.c.kind.in_(_PICTURED))
        newest = pictured.order_by(jobs.c.number.desc()).limit(runs_kept)
        connection.execute(delete(look_pictures).where(look_pictures.c.job.not_in(newest)))


def picture(connection: Connection, name: str, number: int) -> bytes | None:
    """The picture of a look; None when there is none or it is no longer kept."""
    row = find(connection, look_pictures, name, number)
    return None if row is None else bytes(row["image"])
