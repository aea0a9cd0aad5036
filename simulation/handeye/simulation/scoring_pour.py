"""The referee of pouring: which of Table 4.2's subtasks passed, and where the liquid is. No task ever sees this.

Units as in `handeye.simulation.scoring`, whose judgement on approach and grasp is taken over.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from handeye.simulation import liquid
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.scene import WorldState
from handeye.simulation.scoring import MOVED_LIMIT, TILT_LIMIT, CupSize, Track, lowest_point, score

SUBTASKS = ("approach", "grasp", "delivery", "pour", "replace")
"""Of Table 4.2, in order."""

NEAR = 0.10
"""A cup can be poured out from where its axis is so far from the jar's at most: it is about as long."""
ARRIVED = 0.5
"""The pour has passed when more than this share of the liquid arrives (thesis 4.2.6)."""
STANDING = 0.005
"""A cup that stands on the table has its lowest point at most so far above it."""
BESIDE = (0.09, 0.25)
"""A cup that is beside the jar has its axis so far from the jar's."""


@dataclass(frozen=True, slots=True)
class PourScore:
    """`arrived`, `left` and `spilled`: shares of the liquid in the jar, in the cup and elsewhere at the end."""

    passed: Mapping[str, bool]
    arrived: float
    left: float
    spilled: float


def score_pour(states: Sequence[WorldState], cup: ObjectSpec, jar: ObjectSpec, ended: Mapping[str, float]) -> PourScore:
    """Judges a trial from the truth `states`, oldest first, the first one before the hand has moved.

    `ended` holds the world time at which each subtask that was completed ended; one that was not has not passed.

    * *approach* and *grasp*: as `score` has them.
    * *delivery*: when it ended, both fingers held the cup, it stood upright (< 10°) with its bottom above the jar's
      rim and at most 10 cm beside the jar's axis, and the jar had not been moved by 10 mm.
    * *pour*: more than half of the liquid is in the jar at the trial's end, and the jar stands.
    * *replace*: at the trial's end the cup stands on the table, upright, beside the jar, and no finger touches it.
    """
    track, other = Track.of(states, cup.name), Track.of(states, jar.name)
    size, jar_size = CupSize(cup.radius, cup.height), CupSize(jar.radius, jar.height)
    last, lowest = len(states) - 1, lowest_point(track, size)
    end = states[-1]
    particles = len(end.liquid)
    in_jar, in_cup = (int(liquid.inside(end.liquid, spec, end.object(spec.name).pose).sum()) for spec in (jar, cup))
    arrived, left = in_jar / particles, in_cup / particles

    def apart(index: int) -> float:
        return math.hypot(*(track.cup[index, :2] - other.cup[index, :2]))

    def delivered(index: int) -> bool:
        return (
            bool(track.touches[index].all())
            and track.tilt(index) < TILT_LIMIT
            and float(lowest[index]) > jar.height
            and apart(index) <= NEAR
            and float(other.displacement()[: index + 1].max()) < MOVED_LIMIT
        )

    stands = other.tilt(last) < TILT_LIMIT and lowest_point(other, jar_size)[last] < STANDING
    replaced = (
        not np.any(track.touches[last])
        and track.tilt(last) < TILT_LIMIT
        and lowest[last] < STANDING
        and BESIDE[0] <= apart(last) <= BESIDE[1]
    )
    taken = score(track, size, {name: time for name, time in ended.items() if name in ("approach", "grasp")}).passed
    return PourScore(
        passed={
            "approach": taken["approach"],
            "grasp": taken["grasp"],
            "delivery": "delivery" in ended and delivered(track.at(ended["delivery"])),
            "pour": "pour" in ended and arrived > ARRIVED and bool(stands),
            "replace": "replace" in ended and bool(replaced),
        },
        arrived=arrived,
        left=left,
        spilled=1.0 - arrived - left,
    )
