"""Tasks taught by demonstrations, then done at random places: what the evaluations of tasks have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from handeye.client.models import RunJob
from handeye.simulation.evaluation.site import Site, Trial
from handeye.simulation.lessons import Lesson
from handeye.simulation.places import Purpose
from handeye.simulation.report import Picture
from handeye.simulation.scene import WorldState
from handeye.simulation.trying import to_its_end

TAUGHT = 10
"""Demonstrations, as in the thesis's Tables 4.1 and 4.2."""

_TRIAL_TIMEOUT = 900.0  # s
_SAMPLING = 0.05  # s of world time between two looks of the referee
_PICTURED = 2  # trials of the first seed
_MIDWAY = 3  # way-points after which the observer takes a picture

Judge = Callable[[Sequence[WorldState], dict[str, float]], dict[str, Any]]
"""(truth, world time at which each subtask ended) -> what is told of a trial; `passed` by subtask is among it."""


@dataclass(frozen=True, slots=True)
class Table:
    """A task's evaluation: what is taught, what is done before each trial, and who judges."""

    lesson: Lesson
    judge: Judge
    prepare: Callable[[Site], None] = lambda _site: None

    def measure(self, site: Site, seed: int, trials: int, pictures: list[Picture]) -> list[Trial]:
        """Teaches, then lets the task be done at places that were never shown."""
        site.teach(self.lesson.name, TAUGHT, seed)
        told = []
        pictured = 0 if pictures else _PICTURED  # another seed's show the same
        with site.progress(f"{self.lesson.name}: trials", trials) as advance:
            for number, places in enumerate(self.lesson.draw(seed, Purpose.TESTING, trials), start=1):
                site.lab.reset(places[0].seed)
                for spec, place in zip(self.lesson.objects, places, strict=True):
                    site.lab.place(spec, (place.x, place.y), place.yaw)
                self.prepare(site)
                begun = site.lab.world().world_time
                shown = pictures if number <= pictured else None
                job = self._run(site, number, shown)
                history = site.lab.history(begun, every=_SAMPLING)
                subtasks = job.result.subtasks if job.result is not None else ()
                ended = {each.name: each.ended for each in subtasks if each.ended is not None}
                told.append(
                    {
                        "trial": number,
                        "places": [[place.x, place.y, place.yaw] for place in places],
                        **self.judge(history, ended),
                        "looks": {each.name: len(each.looks) for each in subtasks},
                        "world_seconds": history[-1].world_time - begun,
                        "failure": "" if job.succeeded else job.failure,
                    }
                )
                if shown is not None:
                    shown += _looks(site, job, number)
                if not job.succeeded:
                    site.client.reset_robot()
                advance()
        return told

    def _run(self, site: Site, number: int, shown: list[Picture] | None) -> RunJob:
        """The job that has ended; midway the observer adds a picture to what is shown, if anything is."""
        client = site.client
        job = client.start_run(self.lesson.name, self.lesson.objects[0].name)
        passed = 0

        def on_event(event: Any) -> None:
            nonlocal passed
            passed += event.kind == "waypoint"
            if shown is not None and event.kind == "waypoint" and passed == _MIDWAY:
                shown.append(Picture(client.frame("observer"), f"Trial {number}, on the way, by the observer."))

        ended = to_its_end(client, job, _TRIAL_TIMEOUT, on_event)
        assert isinstance(ended, RunJob)  # noqa: S101 # what was started
        return ended


def _looks(site: Site, job: RunJob, number: int) -> Iterator[Picture]:
    """The last look of each subtask, and the observer's view of the end."""
    marks = "left and right picture; red cross: what it is towards, green cross: hand"
    for part in job.result.subtasks if job.result is not None else ():
        for look in part.looks[-1:]:
            yield Picture(site.client.picture(look.picture), f"Trial {number}, {part.name}, last look: {marks}.")
    yield Picture(site.client.frame("observer"), f"Trial {number}, at its end, by the observer.")
