"""The referee of tasks with two objects: which subtasks passed, and where the liquid is. No task ever sees this.

Units as in `handeye.simulation.scoring`, whose judgement on approach and grasp is taken over. A subtask that was not
completed has not passed.
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

POUR_SUBTASKS = ("approach", "grasp", "delivery", "pour", "replace")
"""Of Table 4.2, in order."""
STACK_SUBTASKS = ("approach", "grasp", "carry", "put")

NEAR = 0.10
"""A cup can be poured out from where its axis is so far from the jar's at most: it is about as long."""
ARRIVED = 0.5
"""The pour has passed when more than this share of the liquid arrives (thesis 4.2.6)."""
STANDING = 0.005
"""What stands on something has its lowest point at most so far from it."""
BESIDE = (0.09, 0.25)
"""A cup that is beside the jar has its axis so far from the jar's."""
MIDDLE = 0.02
"""A cup stands in the middle of a stand when their axes are so near."""


@dataclass(frozen=True, slots=True)
class PourScore:
    """`arrived`, `left` and `spilled`: shares of the liquid in the jar, in the cup and elsewhere at the end."""

    passed: Mapping[str, bool]
    arrived: float
    left: float
    spilled: float


def score_pour(states: Sequence[WorldState], cup: ObjectSpec, jar: ObjectSpec, ended: Mapping[str, float]) -> PourScore:
    """Judges a trial from the truth `states`, oldest first, the first one before the hand has moved.

    `ended` holds the world time at which each subtask that was completed ended.

    * *approach* and *grasp*: as `score` has them.
    * *delivery*: when it ended, the cup was held upright (see `_Two.held`) with its bottom above the jar's rim and at
      most 10 cm beside the jar's axis.
    * *pour*: more than half of the liquid is in the jar at the trial's end, and the jar stands where it stood.
    * *replace*: at the trial's end the cup stands on the table, upright, beside the jar, and no finger touches it.
    """
    two = _Two(states, cup, jar)
    end, particles = states[-1], len(states[-1].liquid)
    in_jar, in_cup = (int(liquid.inside(end.liquid, spec, end.object(spec.name).pose).sum()) for spec in (jar, cup))
    arrived, left = in_jar / particles, in_cup / particles
    delivered = two.at(ended, "delivery")
    return PourScore(
        passed={
            **two.taken(ended),
            "delivery": delivered is not None and two.held(delivered) and two.apart(delivered) <= NEAR,
            "pour": "pour" in ended and arrived > ARRIVED and two.other_stands(),
            "replace": "replace" in ended and two.let_go(0.0) and BESIDE[0] <= two.apart(-1) <= BESIDE[1],
        },
        arrived=arrived,
        left=left,
        spilled=1.0 - arrived - left,
    )


def score_stack(
    states: Sequence[WorldState], cup: ObjectSpec, stand: ObjectSpec, ended: Mapping[str, float]
) -> dict[str, bool]:
    """Judges a trial as `score_pour` does: which subtasks passed.

    * *carry*: when it ended, the cup was held upright (see `_Two.held`) with its axis over the stand.
    * *put*: at the trial's end the cup stands upright in the middle of the stand, no finger touches it, and the stand
      is where it was.
    """
    two = _Two(states, cup, stand)
    carried = two.at(ended, "carry")
    return {
        **two.taken(ended),
        "carry": carried is not None and two.held(carried) and two.apart(carried) <= stand.radius,
        "put": "put" in ended and two.let_go(stand.height) and two.apart(-1) <= MIDDLE and two.other_stands(),
    }


class _Two:
    """A trial with a cup and another object; moments are counted as in the history, −1 is its end."""

    def __init__(self, states: Sequence[WorldState], cup: ObjectSpec, other: ObjectSpec) -> None:
        self._cup, self._other = Track.of(states, cup.name), Track.of(states, other.name)
        self._size = CupSize(cup.radius, cup.height)
        self._other_spec = other
        self._lowest = lowest_point(self._cup, self._size)

    def at(self, ended: Mapping[str, float], subtask: str) -> int | None:
        """The moment at which a subtask ended; None when it did not."""
        return self._cup.at(ended[subtask]) if subtask in ended else None

    def taken(self, ended: Mapping[str, float]) -> dict[str, bool]:
        """Approach and grasp, as `score` judges them."""
        first = {name: time for name, time in ended.items() if name in ("approach", "grasp")}
        passed = score(self._cup, self._size, first).passed
        return {"approach": passed["approach"], "grasp": passed["grasp"]}

    def held(self, moment: int) -> bool:
        """Both fingers hold the cup, it is upright (< 10°) and above the other object, which never was moved 10 mm."""
        return (
            bool(self._cup.touches[moment].all())
            and self._cup.tilt(moment) < TILT_LIMIT
            and float(self._lowest[moment]) > self._other_spec.height
            and float(self._other.displacement()[: moment + 1].max()) < MOVED_LIMIT
        )

    def apart(self, moment: int) -> float:
        """Horizontal distance of the axes, in m."""
        return math.hypot(*(self._cup.cup[moment, :2] - self._other.cup[moment, :2]))

    def let_go(self, height: float) -> bool:
        """At the end the cup stands upright on what is so high, in m, and no finger touches it."""
        return (
            not np.any(self._cup.touches[-1])
            and self._cup.tilt(-1) < TILT_LIMIT
            and abs(float(self._lowest[-1]) - height) < STANDING
        )

    def other_stands(self) -> bool:
        """At the end the other object stands upright on the table, within 10 mm of where it was."""
        size = CupSize(self._other_spec.radius, self._other_spec.height)
        return (
            self._other.tilt(-1) < TILT_LIMIT
            and abs(float(lowest_point(self._other, size)[-1])) < STANDING
            and float(self._other.displacement()[-1]) < MOVED_LIMIT
        )
