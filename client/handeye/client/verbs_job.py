"""`handeye job …`: what was done, what is being done, and why."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import typer

from handeye.client.models import Job, Look, RunJob, SubtaskResult
from handeye.client.verbs_common import Token, Url, connect, seen, show, spelled

_NAMED = 3
"""So many of the nearest demonstrations are named per look."""

JobId = Annotated[str, typer.Argument(metavar="JOB", help="Id of the job.")]


def register(app: typer.Typer) -> None:
    """Adds the verb `job`."""
    group = typer.Typer(no_args_is_help=True, help="Jobs: runs, trainings and motions, and why each motion was made.")
    group.command("list")(list_jobs)
    group.command("show")(show_job)
    group.command("cancel")(cancel)
    app.add_typer(group, name="job")


def list_jobs(
    limit: Annotated[int, typer.Option(min=1, help="Show so many at most.")] = 20, url: Url = "", token: Token = ""
) -> None:
    """The newest jobs, newest first."""
    with connect(url, token) as client:
        found = client.jobs(limit)
    show(
        "Jobs",
        ("id", "kind", "of", "with", "state", "created", "why not"),
        [(j.id, j.kind, j.subject, j.object, _state(j), j.created_at, j.error and j.error.message) for j in found],
    )


def show_job(job_id: JobId, url: Url = "", token: Token = "") -> None:
    """How a job went; of a run, every look: what was answered, how sure it was, and which demonstrations said so."""
    with connect(url, token) as client:
        job = client.job(job_id)
    about = f"{job.noun} '{job.subject}'" + (f" with '{job.object}'" if job.object else "")
    typer.echo(f"{about}: {_state(job)}" + (f", {job.error.message}" if job.error else ""))
    times = [("created", job.created_at), ("started", job.started_at), ("ended", job.ended_at)]
    show(f"Job {job.id}", [name for name, _time in times], [[time for _name, time in times]])
    if isinstance(job, RunJob):
        for subtask in job.result.subtasks:
            _show_subtask(subtask)
    elif job.result is not None:
        result = job.result if isinstance(job.result, dict) else dict(job.result)
        show("Result", ("", "value"), [(name, str(value)) for name, value in result.items()])


def cancel(job_id: JobId, url: Url = "", token: Token = "") -> None:
    """Ask a job to end; a motion under way is braked."""
    with connect(url, token) as client:
        job = client.cancel_job(job_id)
    typer.echo(
        f"Job {job.id} is asked to end; it was {_state(job)}." if not job.ended else f"Job {job.id} {job.state}."
    )


def _state(job: Job) -> str:
    return job.state if job.ended or job.progress is None else f"{job.state}, {job.progress:.0%}"


def _show_subtask(subtask: SubtaskResult) -> None:
    then = f", then {subtask.action}" if subtask.action else ""
    show(
        f"{subtask.name}: {subtask.state}{'' if subtask.aligned else ', not aligned'}{then}",
        ("look", "at s", "seen (row, column, disparity)", "joints (rad)", "support", "because of"),
        [_row(look) for look in subtask.looks],
    )


def _row(look: Look) -> tuple[object, ...]:
    return (
        look.number,
        round(look.world_time, 2),
        seen(look.object, look.hand),
        f"answer {spelled(look.delta, 4)}\nmoved  {spelled(look.moved, 4) or '–'}",
        round(look.support, 2),
        "\n".join(_reasons(look)),
    )


def _reasons(look: Look) -> Iterator[str]:
    """The demonstrations with most weight among the nearest samples, and their share in the answer."""
    weights: dict[str, float] = {}
    for neighbour in look.neighbours:
        name = neighbour.demonstration or f"sample {neighbour.sample}"
        weights[name] = weights.get(name, 0.0) + neighbour.weight
    for name, weight in sorted(weights.items(), key=lambda each: -each[1])[:_NAMED]:
        yield f"{name} ({weight:.0%})"
