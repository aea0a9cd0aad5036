"""Grasping as it was taught: from how few demonstrations, by how clumsy a teacher, with how narrow a gripper, how wide
around. Every trial is a cup at a random place, the closed loop, and the referee's judgement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from handeye.client import ApiError
from handeye.robot_bridge.driver import unwatched
from handeye.simulation.collecting import collect
from handeye.simulation.conditions import ORDINARY, Conditions
from handeye.simulation.evaluation.outcome import Figure, count, median, share
from handeye.simulation.evaluation.site import Evaluation, Site, Trial
from handeye.simulation.lessons import grasp
from handeye.simulation.objects import CUPS
from handeye.simulation.places import Place, Purpose, draw, generator
from handeye.simulation.rehearsing import can_grasp, lifted
from handeye.simulation.report import Picture
from handeye.simulation.scatter import CLUMSY, STEADY, Clumsiness
from handeye.simulation.scene import WORKSPACE_SIZE
from handeye.simulation.teacher import Teacher
from handeye.simulation.trying import Judged, Trials

CUP = CUPS["blue cup"]
_WIDE = 0.60  # m


@dataclass(frozen=True, slots=True)
class Course:
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
    Course("10 demonstrations", 10, 98.0, openings=(0.08, 0.07)),
    Course("3 demonstrations", 3, 95.0),
    Course("1 demonstration", 1, 85.0),
)
_CLUMSY = (Course("10 demonstrations by a clumsy teacher", 10, 96.0, CLUMSY),)
_LARGE = (Course("60 × 60 cm, 20 demonstrations", 20, 96.0, size=_WIDE),)


def _measure(courses: Sequence[Course], site: Site, seed: int, trials: int, pictures: list[Picture]) -> list[Trial]:
    """Lets CSS be taught, then teaches each course as a task of its own, and tries it."""
    collect("CSS", site.lab, site.client, seed, site.progress)
    found: list[Trial] = []
    for number, course in enumerate(courses, start=1):
        task = f"grasp {number}"
        teacher = Teacher(site.robot, site.lab, site.client, grasp(CUP), task, unwatched, course.clumsiness)
        if number == 1:
            teacher.register_objects(seed)
        rejected = _teach(site, teacher, course, seed)
        site.client.train(task)
        places, also = possible(site, seed, Purpose.TESTING, trials, course.size)
        for conditions in (ORDINARY, *(Conditions(opening=opening) for opening in course.openings)):
            found += [
                {"course": _spoken(course, conditions), "rejected": rejected + also, **told(judged)}
                for judged in _tried(site, task, course, places, conditions)
            ]
        pictures.append(Picture(site.client.frame("observer"), f"{course.name}, seed {seed}: the last trial's end."))
    return found


def _tried(site: Site, task: str, course: Course, places: Sequence[Place], conditions: Conditions) -> Iterator[Judged]:
    trying = Trials(site.client, site.lab, CUP, task, site.stack.check)
    with site.progress(_spoken(course, conditions), len(places)) as advance:
        for number, place in enumerate(places, start=1):
            yield trying.at(number, place, conditions=conditions)
            advance()


def _spoken(course: Course, conditions: Conditions) -> str:
    narrow = "" if conditions == ORDINARY else f", gripper opens {1e3 * conditions.opening:.0f} mm"
    return course.name + narrow


def _teach(site: Site, teacher: Teacher, course: Course, seed: int) -> int:
    """Shows the course's demonstrations; how many places were rejected for them."""
    # A teacher whose cup was not lifted shows one more.
    places, rejected = possible(site, seed, Purpose.TEACHING, 2 * course.demonstrations, course.size)
    random = generator(seed, Purpose.MOTIONS)
    shown = 0
    with site.progress(f"teaching: {course.name}", course.demonstrations) as advance:
        for place in places:
            try:
                demonstration = teacher.demonstrate((place,), random, lambda: None)
            except ApiError as error:
                if error.code != "not_seen":
                    raise
                rejected += 1  # the hand hides the cup where it is to grasp
                continue
            if lifted(site.lab.world(), CUP):
                shown += 1
                advance()
            else:
                site.client.label_demonstration(demonstration, "failure")
            if shown == course.demonstrations:
                break
    return rejected


def show(site: Site, teacher: Teacher, seed: int, demonstrations: int, title: str) -> None:
    """Shows so many demonstrations at a seed's places in the ordinary square."""
    motions = generator(seed, Purpose.MOTIONS)
    with site.progress(title, demonstrations) as advance:
        for place in draw(seed, Purpose.TEACHING, demonstrations):
            teacher.demonstrate((place,), motions, lambda: None)
            advance()


def possible(site: Site, seed: int, purpose: Purpose, count: int, size: float) -> tuple[list[Place], int]:
    """`count` random places in a square, and how many were rejected: where the teacher's hand cannot grasp.

    In the ordinary square it can everywhere.
    """
    drawn = draw(seed, purpose, count * (1 if size <= WORKSPACE_SIZE else 6), size)
    if size <= WORKSPACE_SIZE:
        return list(drawn), 0
    places: list[Place] = []
    for tried, place in enumerate(drawn, start=1):
        if can_grasp(site.robot, site.lab, CUP, place):
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


def _figures(courses: Sequence[Course], found: Sequence[Trial]) -> tuple[Figure, ...]:
    figures = []
    for course in courses:
        for conditions in (ORDINARY, *(Conditions(opening=opening) for opening in course.openings)):
            name = _spoken(course, conditions)
            tried = [each for each in found if each["course"] == name]
            ordinary = conditions == ORDINARY
            thesis = "10 of 10" if course is _FEW[0] and ordinary else ""
            figures.append(share(name, [each["well"] for each in tried], course.least if ordinary else None, thesis))
            if ordinary:
                figures += [
                    median(f"{name}: miss at closing", [each["miss_mm"] for each in tried], "mm", 2.0),
                    median(f"{name}: cup pushed", [each["pushed_mm"] for each in tried], "mm", 2.0),
                ]
            if ordinary and course.size > WORKSPACE_SIZE:
                rejected = {each["seed"]: each["rejected"] for each in tried}
                figures.append(
                    count(f"{name}: places rejected, out of the teacher's reach", sum(rejected.values()), len(tried))
                )
    return tuple(figures)


def _histograms(found: Sequence[Trial]) -> dict[str, tuple[float, ...]]:
    courses = dict.fromkeys(each["course"] for each in found)
    return {
        f"{course}: miss at closing, in mm": tuple(each["miss_mm"] for each in found if each["course"] == course)
        for course in courses
    }


def _evaluation(name: str, title: str, courses: Sequence[Course]) -> Evaluation:
    return Evaluation(name, title, partial(_measure, courses), partial(_figures, courses), _histograms)


GRASP = _evaluation("grasp", "Grasping, by how few demonstrations and with how narrow a gripper", _FEW)
CLUMSY_TEACHER = _evaluation("clumsy", "Grasping as a clumsy teacher showed it", _CLUMSY)
WIDE = _evaluation("wide", "Grasping in a square of 60 × 60 cm", _LARGE)
