"""Samples for SCS by fixating: the head turns until an object is in the middle of the left picture.

How the head turns pictures is not known beforehand. Two small turns tell how the object moves in the picture, and each
further one tells it better (Broyden, "A class of methods for solving nonlinear simultaneous equations", 1965). Once the
object is in the middle, every look on the way there is a sample: from there it would have been so far.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from handeye.modules import scs
from handeye.modules.recognition import NotSeen
from handeye.modules.spaces import Floats, HeadAngles, ImagePoint
from handeye.rpc.errors import OutOfLimits
from handeye.server.collecting.gathering import Gathering
from handeye.server.eyes import Eyes
from handeye.server.gaze import middle
from handeye.server.job import Job
from handeye.server.looking import Looker
from handeye.server.problem import Conflict

Keep = Literal["all", "first", "last"]
"""Which looks of a fixation become samples: all, the first one (far away), or the last one (nearly centred)."""

_PROBE = 0.04  # rad
_LARGEST_STEP = 0.3  # rad
_MOST_LOOKS = 12
_CENTRED = 0.6  # px: nearer than that the head's steps do not come
_ACCEPTABLE = 3.0  # px: the rest is extrapolated


class NotFixated(Conflict):
    """The object did not come to the middle of the picture."""

    code = "not_fixated"


@dataclass(frozen=True, slots=True)
class _Seen:
    """A look: where the head was, what it saw, and how far that is from the middle, (rows, columns) in px."""

    head: Floats
    point: ImagePoint
    offset: Floats


class Fixation:
    """One fixation of a resting object from where the head points. `execute` may be called once."""

    def __init__(self, looker: Looker, eyes: Eyes, gathering: Gathering, job: Job) -> None:
        self._looker = looker
        self._eyes = eyes
        self._gathering = gathering
        self._job = job
        self._looks: list[_Seen] = []

    def execute(self, object_name: str, keep: Keep) -> None:
        """Fixates, and teaches SCS what was learned by it; raises `NotSeen` and `NotFixated`."""
        self._look(object_name)
        change = np.column_stack([self._probe(object_name, axis) for axis in (0, 1)])
        while len(self._looks) < _MOST_LOOKS and np.hypot(*self._looks[-1].offset) > _CENTRED:
            before = self._looks[-1]
            step = _limited(-_solved(change, before.offset))
            self._turn_and_look(object_name, before.head + step)
            after = self._looks[-1]
            done = after.head - before.head
            if not done.any():  # less than a step of the head is left
                break
            change += np.outer(after.offset - before.offset - change @ done, done) / (done @ done)
        last = self._looks[-1]
        if (left := float(np.hypot(*last.offset))) > _ACCEPTABLE:
            raise NotFixated(
                f"Object '{object_name}' is still {left:.1f} px from the middle after {len(self._looks)} looks: see "
                "that it rests, and that it is well in view."
            )
        self._require_rest(object_name)
        self._teach(last.head - _solved(change, last.offset), keep)

    def _require_rest(self, object_name: str) -> None:
        """From where the head looked first the object must still be seen where it was: else the looks do not agree.

        In the end the head points at it once more.
        """
        first, last = self._looks[0], self._looks[-1]
        self._turn_and_look(object_name, first.head)
        again = self._looks.pop()
        self._looker.turn(HeadAngles(*last.head.tolist()))
        if (moved := float(np.hypot(*(again.offset - first.offset)))) > _ACCEPTABLE:
            self._gathering.reject("moving")
            raise NotFixated(f"Object '{object_name}' has moved by {moved:.1f} px meanwhile: it must rest.")

    def _probe(self, object_name: str, axis: int) -> Floats:
        """(2,) px/rad: how the object moves in the picture with one of the head's axes."""
        before = self._looks[-1]
        for step in (_PROBE, -_PROBE):
            head = before.head.copy()
            head[axis] += step
            try:
                self._turn_and_look(object_name, head)
            except NotSeen:
                self._gathering.reject("not seen")
                continue
            except OutOfLimits:  # at the end of the head's range
                continue
            after = self._looks[-1]
            if turned := (after.head - before.head)[axis]:
                change: Floats = (after.offset - before.offset) / turned
                return change
            raise NotFixated("The head does not turn.")
        raise NotFixated(f"Object '{object_name}' is lost from view by the smallest turns: put it further in.")

    def _turn_and_look(self, object_name: str, head: Floats) -> None:
        self._looker.turn(HeadAngles(*head.tolist()))
        self._look(object_name)

    def _look(self, object_name: str) -> None:
        self._job.check()
        _, pair = self._looker.look()
        point = self._eyes.find(pair, object_name)
        offset = np.array([point.row, point.column]) - middle(pair)
        self._looks.append(_Seen(np.array([pair.head.pan, pair.head.tilt]), point, offset))

    def _teach(self, centred: Floats, keep: Keep) -> None:
        """`centred` (2,): the pan and tilt, in rad, at which the object is in the middle."""
        looks = {"all": self._looks, "first": self._looks[:1], "last": self._looks[-1:]}[keep]
        name = f"fixation-{self._gathering.origins('SCS', 'fixation') + 1}"
        self._gathering.add(
            "SCS",
            np.array([scs.input_vector(look.point, float(look.head[1])) for look in looks]),
            np.array([centred - look.head for look in looks]),
            [name] * len(looks),
        )


def _solved(change: Floats, offset: Floats) -> Floats:
    """(2,) rad: the turn that moves the object by `offset` px. `NotFixated` when turns do not move it so."""
    try:
        return np.asarray(np.linalg.solve(change, offset), np.float64)
    except np.linalg.LinAlgError:
        raise NotFixated("The object does not move in the picture when the head turns: it must rest.") from None


def _limited(step: Floats) -> Floats:
    largest = float(np.abs(step).max())
    return step if largest <= _LARGEST_STEP else step * (_LARGEST_STEP / largest)
