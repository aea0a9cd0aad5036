"""Smooth pursuit in realtime: a cup is pushed about on the table, and the head is to keep it in the middle.

Offsets are those in the system's own pictures, which are taken while the head turns. How many pictures there are in a
second is how fast the machine renders them, and no feat of the system's.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from handeye.cli.up import Clock
from handeye.client.models import PursuitLook
from handeye.simulation.collecting import collect
from handeye.simulation.evaluation.outcome import Figure, average, quantile
from handeye.simulation.evaluation.reaching import towards
from handeye.simulation.evaluation.site import Evaluation, Site, Trial
from handeye.simulation.objects import CUPS
from handeye.simulation.report import Picture

SPEEDS = (0.02, 0.05, 0.10, 0.15)
"""m/s; trials take turns."""
LOWER, UPPER = np.array([0.45, -0.35]), np.array([0.80, 0.35])
"""The cup is pushed straight across this part of the table, (x, y) in m."""
LEAST = 0.25
"""Its way is at least so long, in m."""
LONGEST = 10.0
"""And a pursuit lasts as long as that takes, but no longer than so many s."""

_CUP = CUPS["blue cup"]
_PICTURED = len(SPEEDS)

Array = NDArray[np.float64]


def _measure(site: Site, seed: int, trials: int, pictures: list[Picture]) -> list[Trial]:
    """Collects 45 samples by fixating a ball, learns what the cup looks like, then pushes it about."""
    site.experimenter.register_cup(_CUP)
    collect("SCS", site.lab, site.client, seed, site.progress)
    random = np.random.default_rng([seed, 2])
    told: list[Trial] = []
    with site.progress("pursuing", trials) as advance:
        for speed in itertools.islice(itertools.cycle(SPEEDS), trials):
            told.append(_trial(site, random, speed))
            if len(told) <= _PICTURED:
                caption = (
                    f"Seed {seed}, {100 * speed:g} cm/s: the left picture just after the pursuit, the head at rest."
                )
                pictures.append(Picture(site.client.frame("left"), caption))
            advance()
    return told


def _trial(site: Site, random: np.random.Generator, speed: float) -> Trial:
    """One push and the pursuit of it, from a head that has the cup in the middle."""
    start, goal = across(random)
    site.lab.reset(int(random.integers(2**31)))
    site.lab.place(_CUP, start)
    with site.client.control("referee") as control:
        control.turn_head(*towards(np.array([*start, _CUP.height / 2])))
    gaze = site.client.gaze(_CUP.name)
    ends = site.lab.push(_CUP.name, goal[None], speed)
    duration = min(LONGEST, ends - site.lab.world().world_time)
    job = site.client.pursue(_CUP.name, duration)
    # The last look comes when the time is over, and the cup may be at rest by then.
    looks = [look for look in job.result.looks if look.world_time <= ends] if job.result is not None else []
    return {
        "speed": speed,
        "start": start.tolist(),
        "goal": goal.tolist(),
        "duration": duration,
        "gaze": gaze.state,
        "failure": "" if job.succeeded else job.failure,
        "times": [look.world_time for look in looks],
        "offsets": [look.offset for look in looks],
        "late": [look.late for look in looks],
        "lost": lost(looks, duration),
    }


def across(random: np.random.Generator) -> tuple[Array, Array]:
    """Where a push begins and ends, (2,) each in m: from border to border, through any place in any direction."""
    while True:
        place, heading = random.uniform(LOWER, UPPER), random.uniform(-np.pi, np.pi)
        direction = np.array([np.cos(heading), np.sin(heading)])
        sides = np.array([(LOWER - place) / direction, (UPPER - place) / direction])
        back, forth = sides.min(axis=0).max(), sides.max(axis=0).min()
        if forth - back >= LEAST:
            return place + back * direction, place + forth * direction


def lost(looks: Sequence[PursuitLook], duration: float) -> float:
    """For which share of `duration` s a pursuit did not have the object: from each look that missed it to the next."""
    if not looks:
        return 1.0
    ends = [*(look.world_time for look in looks[1:]), looks[0].world_time + duration]
    had = sum(
        max(0.0, min(end, ends[-1]) - look.world_time)
        for look, end in zip(looks, ends, strict=True)
        if look.offset is not None
    )
    return max(0.0, 1.0 - had / duration)


def _figures(trials: Sequence[Trial]) -> tuple[Figure, ...]:
    between = [after - before for each in trials for before, after in itertools.pairwise(each["times"])]
    late = [value for each in trials for value in each["late"] if value is not None]
    return (
        *_of("all speeds", trials),
        *(figure for name, some in _by_speed(trials) for figure in _of(name, some)),
        average("time from picture to picture", between, "s"),
        average("from a picture's exposure until the head was told", late, "s"),
    )


def _of(name: str, trials: Sequence[Trial]) -> Iterator[Figure]:
    seen = [offset for each in trials for offset in each["offsets"] if offset is not None]
    if seen:
        yield average(f"{name}: mean offset", seen, "px")
        yield quantile(f"{name}: 95 % of the offsets are below", seen, 0.95, "px")
    yield average(f"{name}: time lost", [100.0 * each["lost"] for each in trials], "%")


def _by_speed(trials: Sequence[Trial]) -> Iterator[tuple[str, list[Trial]]]:
    for speed in SPEEDS:
        some = [each for each in trials if each["speed"] == speed]
        if some:
            yield f"{100 * speed:g} cm/s", some


def _histograms(trials: Sequence[Trial]) -> dict[str, tuple[float, ...]]:
    return {
        f"Offset in each picture at {name}, in px": tuple(
            offset for each in some for offset in each["offsets"] if offset is not None
        )
        for name, some in _by_speed(trials)
    }


EVALUATION = Evaluation(
    "pursuit",
    "Smooth pursuit (SCS) of a cup pushed about on the table, in realtime",
    _measure,
    _figures,
    _histograms,
    Clock.REALTIME,
)
