"""Whether low support foretells failure: every trial is run to its end, however little support its answers have, at
places that were taught and at places far from them. A task would have held where support was below its bound."""

from __future__ import annotations

from collections.abc import Sequence

from handeye.robot_bridge.driver import unwatched
from handeye.simulation.collecting import collect
from handeye.simulation.evaluation.grasp import CUP, possible, told
from handeye.simulation.evaluation.outcome import Figure, share
from handeye.simulation.evaluation.site import Evaluation, Site, Trial
from handeye.simulation.lessons import grasp
from handeye.simulation.places import Purpose, generator
from handeye.simulation.report import Picture
from handeye.simulation.scene import WORKSPACE_SIZE
from handeye.simulation.teacher import Teacher
from handeye.simulation.trying import Judged, Trials

_TASK = "grasp"
_TAUGHT = 3
_WIDE = 0.60  # m
_LEAST_SUPPORT = 0.2  # as tasks are set
_TOUCHED = 2.0  # mm that a cup has moved


def _measure(site: Site, seed: int, trials: int, pictures: list[Picture]) -> list[Trial]:
    """Teaches three demonstrations in the ordinary square, and tries in one with four times its area."""
    collect("CSS", site.lab, site.client, seed, site.progress)
    teacher = Teacher(site.robot, site.lab, site.client, grasp(CUP), _TASK, unwatched)
    teacher.register_objects(seed)
    taught, _ = possible(site, seed, Purpose.TEACHING, _TAUGHT, WORKSPACE_SIZE)
    motions = generator(seed, Purpose.MOTIONS)
    for place in taught:
        teacher.demonstrate((place,), motions, lambda: None)
    site.client.train(_TASK)
    places, _ = possible(site, seed, Purpose.TESTING, trials, _WIDE)
    trying = Trials(site.client, site.lab, CUP, _TASK, site.stack.check)
    found = []
    with site.progress("trials without holding", trials) as advance:
        for number, place in enumerate(places, start=1):
            judged = trying.at(number, place, least_support=0.0)
            found.append(
                {**told(judged), "support_before": _support_before(judged), "untouched": _ended_untouched(judged)}
            )
            advance()
    pictures.append(Picture(site.client.frame("observer"), f"Seed {seed}: the last trial's end."))
    return found


def _support_before(judged: Judged) -> float:
    """The least support of an answer until the gripper closed for the first time."""
    least = 1.0
    for part in judged.job.result.subtasks:
        least = min([least, *(look.support for look in part.looks)])
        if part.action is not None:
            break
    return least


def _ended_untouched(judged: Judged) -> bool:
    """Whether the task ended by itself, and said why, before the cup was moved or the gripper had closed."""
    closed = any(part.action is not None and part.state == "succeeded" for part in judged.job.result.subtasks)
    return bool(judged.trial.failure) and not closed and judged.trial.pushed_mm < _TOUCHED


def _figures(found: Sequence[Trial]) -> tuple[Figure, ...]:
    failing = [each for each in found if not each["well"]]
    good = [each for each in found if each["well"]]

    def flagged(trials: Sequence[Trial]) -> list[bool]:
        return [each["support_before"] < _LEAST_SUPPORT for each in trials]

    figures = [share("trials that end well when nothing holds them", [each["well"] for each in found])]
    if failing:
        untouched = [each["untouched"] for each in failing]
        figures += [
            share("of failing trials flagged beforehand", flagged(failing), 80.0),
            share("of failing trials ended by themselves with the cup untouched", untouched),
        ]
    if good:
        figures.append(share("of good trials held in vain", flagged(good), most=5.0))
    return tuple(figures)


def _histograms(found: Sequence[Trial]) -> dict[str, tuple[float, ...]]:
    return {
        f"Least support before closing, of trials that {how}": tuple(
            each["support_before"] for each in found if each["well"] is well
        )
        for how, well in (("ended well", True), ("failed", False))
    }


EVALUATION = Evaluation("support", "Support foretells failure", _measure, _figures, _histograms)
