"""Grasping as it was taught: from how few demonstrations, by how clumsy a teacher, with how narrow a gripper, how wide
around. Every trial is a cup at a random place, the closed loop, and the referee's judgement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from handeye.robot_bridge.driver import unwatched
from handeye.simulation.conditions import ORDINARY, Conditions
from handeye.simulation.evaluation.outcome import Figure, median, share
from handeye.simulation.evaluation.site import Evaluation, Site, Trial
from handeye.simulation.objects import CUPS
from handeye.simulation.places import Place, Purpose, draw, generator
from handeye.simulation.report import Picture
from handeye.simulation.scene import WORKSPACE_SIZE
from handeye.simulation.teacher import CLUMSY, STEADY, Clumsiness, Teacher
from handeye.simulation.trying import Judged, Trials

CUP = CUPS["blue cup"]
_WIDE = 0.60  # m


@dataclass(frozen=True, slots=True)
class Lesson:
    """One way of teaching, and the trials that follow it."""

    name: str
    demonstrations: int
    least: float
    """Target: so many of the trials pass, in %."""
    clumsiness: Clumsiness = STEADY
    size: float = WORKSPACE_SIZE
    """Edge of the square in which cups stand, in m."""
    openings: tuple[float, ...] = ()
    """Narrower openings of the gripper, in m, that are tried with what was taught with the full one."""


_FEW = (
    Lesson("10 demonstrations", 10, 98.0, openings=(0.08, 0.07)),
    Lesson("3 demonstrations", 3, 95.0),
    Lesson("1 demonstration", 1, 85.0),
)
_CLUMSY = (Lesson("10 demonstrations by a clumsy teacher", 10, 96.0, CLUMSY),)
_LARGE = (Lesson("60 × 60 cm, 20 demonstrations", 20, 96.0, size=_WIDE),)


def _measure(lessons: Sequence[Lesson], site: Site, seed: int, trials: int, pictures: list[Picture]) -> list[Trial]:
    """Teaches each lesson as a task of its own, and tries it."""
    found: list[Trial] = []
    for number, lesson in enumerate(lessons, start=1):
        task = f"grasp {number}"
        teacher = Teacher(site.robot, site.lab, site.client, CUP, task, unwatched, lesson.clumsiness)
        if number == 1:
            teacher.register_object(seed)
        rejected = _teach(site, teacher, lesson, seed)
        site.client.train(task)
        places, also = possible(teacher, seed, Purpose.TESTING, trials, lesson.size)
        for conditions in (ORDINARY, *(Conditions(opening=opening) for opening in lesson.openings)):
            found += [
                {"lesson": _spoken(lesson, conditions), "rejected": rejected + also, **told(judged)}
                for judged in _tried(site, task, lesson, places, conditions)
            ]
        pictures.append(Picture(site.client.frame("observer"), f"{lesson.name}, seed {seed}: the last trial's end."))
    return found


def _tried(site: Site, task: str, lesson: Lesson, places: Sequence[Place], conditions: Conditions) -> Iterator[Judged]:
    trying = Trials(site.client, site.lab, CUP, task, site.check)
    with site.progress(_spoken(lesson, conditions), len(places)) as advance:
        for number, place in enumerate(places, start=1):
            yield trying.at(number, place, conditions=conditions)
            advance()


def _spoken(lesson: Lesson, conditions: Conditions) -> str:
    narrow = "" if conditions == ORDINARY else f", gripper opens {1e3 * conditions.opening:.0f} mm"
    return lesson.name + narrow


def _teach(site: Site, teacher: Teacher, lesson: Lesson, seed: int) -> int:
    """Shows the lesson's demonstrations; how many places were rejected for them."""
    # A teacher whose cup was not lifted shows one more.
    places, rejected = possible(teacher, seed, Purpose.TEACHING, 2 * lesson.demonstrations, lesson.size)
    random = generator(seed, Purpose.MOTIONS)
    shown = 0
    with site.progress(f"teaching: {lesson.name}", lesson.demonstrations) as advance:
        for place in places:
            if teacher.demonstrate(place, random, lambda: None):
                shown += 1
                advance()
            if shown == lesson.demonstrations:
                break
    return rejected


def possible(teacher: Teacher, seed: int, purpose: Purpose, count: int, size: float) -> tuple[list[Place], int]:
    """`count` random places in a square, and how many were rejected: where the teacher's hand cannot grasp.

    In the ordinary square it can everywhere.
    """
    drawn = draw(seed, purpose, count * (1 if size <= WORKSPACE_SIZE else 6), size)
    if size <= WORKSPACE_SIZE:
        return list(drawn), 0
    places: list[Place] = []
    for tried, place in enumerate(drawn, start=1):
        if teacher.can_grasp(place):
            places.append(place)
        if len(places) == count:
            return places, tried - count
    raise ValueError(f"only {len(places)} of {len(drawn)} places can be grasped at")


def told(judged: Judged) -> Trial:
    """A judged trial as it stands in the JSON."""
    trial = judged.trial
    looks = [look for part in judged.job.result.subtasks for look in part.looks]
    return {
        **trial.as_json(),
        "well": trial.well,
        "failure": trial.failure,
        "held": judged.job.error is not None and judged.job.error.code == "outside_taught_region",
        "support": min((look.support for look in looks), default=0.0),
    }


def _figures(lessons: Sequence[Lesson], found: Sequence[Trial]) -> tuple[Figure, ...]:
    figures = []
    for lesson in lessons:
        for conditions in (ORDINARY, *(Conditions(opening=opening) for opening in lesson.openings)):
            name = _spoken(lesson, conditions)
            tried = [each for each in found if each["lesson"] == name]
            ordinary = conditions == ORDINARY
            thesis = "10 of 10" if lesson is _FEW[0] and ordinary else ""
            figures.append(share(name, [each["well"] for each in tried], lesson.least if ordinary else None, thesis))
            if ordinary:
                figures += [
                    median(f"{name}: miss at closing", [each["miss_mm"] for each in tried], "mm", 2.0),
                    median(f"{name}: cup pushed", [each["pushed_mm"] for each in tried], "mm", 2.0),
                ]
    return tuple(figures)


def _histograms(found: Sequence[Trial]) -> dict[str, tuple[float, ...]]:
    lessons = dict.fromkeys(each["lesson"] for each in found)
    return {
        f"{lesson}: miss at closing, in mm": tuple(each["miss_mm"] for each in found if each["lesson"] == lesson)
        for lesson in lessons
    }


def _evaluation(name: str, title: str, lessons: Sequence[Lesson]) -> Evaluation:
    return Evaluation(name, title, partial(_measure, lessons), partial(_figures, lessons), _histograms)


GRASP = _evaluation("grasp", "Grasping, by how few demonstrations and with how narrow a gripper", _FEW)
CLUMSY_TEACHER = _evaluation("clumsy", "Grasping as a clumsy teacher showed it", _CLUMSY)
WIDE = _evaluation("wide", "Grasping in a square of 60 × 60 cm", _LARGE)
