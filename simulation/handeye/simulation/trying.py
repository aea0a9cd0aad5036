"""Trials of a taught task: the world made anew, the object put down, the task run, and the referee's judgement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from handeye.cli import CliError
from handeye.client import Client, TimedOut
from handeye.client.models import Job, OnEvent
from handeye.simulation.conditions import ORDINARY, Conditions
from handeye.simulation.lab import LabClient
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.places import Place
from handeye.simulation.report import Trial
from handeye.simulation.scoring import CupSize, Track, score

TRIAL_TIMEOUT = 120.0
"""A trial that takes longer has failed, in s."""
SAMPLING = 0.02
"""The referee looks at the truth every so many s of world time."""


@dataclass(frozen=True, slots=True)
class Judged:
    """A trial with the job that it was."""

    trial: Trial
    job: Job
    track: Track


class Trials:
    """Tries a trained task with an object at one place after the other."""

    def __init__(self, client: Client, lab: LabClient, spec: ObjectSpec, task: str, check: Callable[[], None]) -> None:
        """`check` raises when the stack cannot be gone on with."""
        self._client = client
        self._lab = lab
        self._spec = spec
        self._task = task
        self._check = check

    def at(
        self,
        number: int,
        place: Place,
        *,
        one_look: bool = False,
        least_support: float | None = None,
        conditions: Conditions = ORDINARY,
        before: Callable[[Place], None] | None = None,
    ) -> Judged:
        """One trial. `least_support` stands for the server's setting; `before` the task begins it may do something.

        A job that failed by itself has stopped the arm and is a failed trial. A process that died, and a stop by
        somebody else, end all.
        """
        self._check()
        self._lab.reset(place.seed, conditions)
        self._lab.place(self._spec, (place.x, place.y), place.yaw)
        if before is not None:
            before(place)
        placed = self._lab.world().world_time
        job = self._run(one_look, least_support)
        track = Track.of(self._lab.history(placed, every=SAMPLING), self._spec.name)
        ended = {part.name: part.ended for part in job.result.subtasks if part.ended is not None}
        result = score(track, CupSize(self._spec.radius, self._spec.height), ended)
        trial = Trial(
            number=number,
            place=place,
            passed=dict(result.passed),
            miss_mm=result.miss_mm,
            pushed_mm=result.pushed_mm,
            looks=sum(len(part.looks) for part in job.result.subtasks),
            world_seconds=float(track.time[-1] - track.time[0]),
            failure="" if job.succeeded else job.failure,
        )
        return Judged(trial, job, track)

    def _run(self, one_look: bool, least_support: float | None) -> Job:
        """The task as a job that has ended, the robot free to move again."""
        started = self._client.start_run(self._task, self._spec.name, one_look=one_look, least_support=least_support)
        job = to_its_end(self._client, started, TRIAL_TIMEOUT)
        if not job.succeeded:
            self._check()
            if job.error is not None and job.error.code == "stopped":
                raise CliError(f"the robot was stopped from outside during a trial: {job.failure}")
            self._client.reset_robot()
        return job


def to_its_end(client: Client, started: Job, timeout: float, on_event: OnEvent = lambda _event: None) -> Job:
    """A job that has ended; it is cancelled when it has not after `timeout` s."""
    try:
        return client.follow(started.id, timeout, on_event)
    except TimedOut:
        client.cancel_job(started.id)
        return client.follow(started.id, timeout)
