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
from handeye.simulation.evaluation.site import Evaluation, Site, Trial
from handeye.simulation.objects import CUPS
from handeye.simulation.report import Picture

SPEEDS = (0.02, 0.05, 0.10, 0.15)
"""m/s; trials take turns."""
LOWER, UPPER = np.array([0.50, -0.30]), np.array([0.85, 0.30])
"""The cup is pushed within this part of the table, (x, y) in m; at its border it turns round."""
DURATION = 10.0
"""How long a pursuit lasts, in s."""

_CUP = CUPS["blue cup"]
_LONGER = 8.0  # s that the push outlasts it: it begins before the first picture is there
_PICTURED = len(SPEEDS)

Array = NDArray[np.float64]


def _measure(site: Site, seed: int, trials: int, pictures: list[Picture]) -> list[Trial]:
    """Collects 45 samples by fixating a ball, learns what the cup looks like, then pushes it about."""
    client = site.client
    site.experimenter.register_cup(_CUP)
    collect("SCS", site.lab, client, seed, site.progress)
    random = np.random.default_rng([seed, 2])
    told: list[Trial] = []
    with site.progress("pursuing", trials) as advance:
        for speed in itertools.islice(itertools.cycle(SPEEDS), trials):
            path = pushed(random, speed * (DURATION + _LONGER))
            site.lab.reset(int(random.integers(2**31)))
            site.lab.place(_CUP, path[0])
            gaze = client.gaze(_CUP.name)
            site.lab.push(_CUP.name, path[1:], speed)
            job = client.pursue(_CUP.name, DURATION)
            looks = job.result.looks if job.result is not None else ()
            told.append(
                {
                    "speed": speed,
                    "path": path.tolist(),
                    "gaze": gaze.state,
                    "failure": "" if job.succeeded else job.failure,
                    "times": [look.world_time for look in looks],
                    "offsets": [look.offset for look in looks],
                    "late": [look.late for look in looks],
                    "lost": lost(looks),
                }
            )
            if len(told) <= _PICTURED:
                caption = (
                    f"Seed {seed}, {100 * speed:g} cm/s: the left picture just after the pursuit, the head at rest."
                )
                pictures.append(Picture(client.frame("left"), caption))
            advance()
    return told


def pushed(random: np.random.Generator, length: float) -> Array:
    """A path (n, 2) of so many m from anywhere in any direction, thrown back at the border like a billiard ball."""
    place, heading = random.uniform(LOWER, UPPER), random.uniform(-np.pi, np.pi)
    direction = np.array([np.cos(heading), np.sin(heading)])
    places = [place]
    while length > 1e-9:
        border = np.where(direction > 0.0, UPPER, LOWER)
        with np.errstate(divide="ignore"):
            until = np.abs((border - place) / direction)
        way = min(length, float(until.min()))
        place = np.clip(place + way * direction, LOWER, UPPER)
        places.append(place)
        direction = np.where(until <= way, -direction, direction)
        length -= way
    return np.array(places)


def lost(looks: Sequence[PursuitLook]) -> float:
    """For which share of its time a pursuit did not have the object: from each look that missed it until the next."""
    if not looks:
        return 1.0
    ends = [*(look.world_time for look in looks[1:]), looks[0].world_time + DURATION]
    had = sum(
        max(0.0, min(end, ends[-1]) - look.world_time)
        for look, end in zip(looks, ends, strict=True)
        if look.offset is not None
    )
    return max(0.0, 1.0 - had / DURATION)


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
