"""Reaching in a closed loop by the five-module chain: look, think, move a part of the way, look again.

The thesis proposed it (Figs 1.5 and 3.1) and never put it together. Where the hand is to be and where it is go the same
way, from the pictures into the arm's frame: what that way gets wrong there is wrong for both, and goes as they meet.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from handeye.camera_bridge.driver import StereoPair
from handeye.modules.recognition import NotSeen
from handeye.modules.spaces import ArmPoint, Floats, HeadAngles, ImagePair, ImagePoint, JointAngles, JointDifference
from handeye.robot_bridge.driver import RobotState
from handeye.server.acting import ActingRobot, OutsideTaughtRegion, too_far
from handeye.server.album import Album
from handeye.server.chain import Chain, Said
from handeye.server.eyes import Eyes
from handeye.server.gaze import require_support
from handeye.server.job import Job
from handeye.server.looking import Looker
from handeye.server.pictures import side_by_side
from handeye.server.problem import Conflict
from handeye.server.results import AnswerRecord, NeighbourRecord, ReachLook, ReachResult

_NEIGHBOURS_RECORDED = 5  # of each module's answer


class NotReached(Conflict):
    """The looks have run out and the hand is not where it should be."""

    code = "not_reached"


class ReachSettings(BaseModel):
    """How the hand is brought to a point."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    max_looks: int = Field(default=6, ge=2)
    """Looks before it gives up, or is content with what is acceptable."""
    tolerance: float = Field(default=0.0006, gt=0.0)
    """The hand is there when it is seen to be no further away, in m."""
    acceptable: float = Field(default=0.002, gt=0.0)
    """When the looks have run out this is near enough, in m: it is noise that keeps it from coming closer."""
    far: float = Field(default=0.06, gt=0.0)
    """From further away, in m, it goes only a part of the way before it looks again: errors grow with the way."""
    part: float = Field(default=0.8, gt=0.0, le=1.0)
    """Which part."""
    moved: float = Field(default=0.01, gt=0.0)
    """An object that is seen further than that from where it was, in m, has been moved: the hand goes there now."""
    largest_correction: float = Field(default=0.06, ge=0.0)
    """An arm that does not come where it was sent is sent so far beyond at most, in m."""
    least_support: float = Field(default=0.2, ge=0.0, le=1.0)
    """An answer with less support lies outside the taught region: the arm holds."""
    largest_move: float = Field(default=2.0, gt=0.0)
    """No joint is turned further by one answer, in rad; an answer that asks for more is wrong."""


@dataclass(frozen=True, slots=True)
class _Goal:
    """Where the hand is to be: as it was seen, in the arm's frame, and who says so."""

    seen: ImagePoint
    place: ArmPoint
    answers: tuple[Said, ...]


class Reach:
    """One reach of the hand to a point of the stereo image, or to an object. `execute` may be called once.

    A point is meant for the head as it stands at the first look. An object is looked for again at each look.
    """

    def __init__(
        self,
        chain: Chain,
        robot: ActingRobot,
        looker: Looker,
        eyes: Eyes,
        settings: ReachSettings,
        thinking: float,
        job: Job,
        album: Album,
    ) -> None:
        """`thinking`: world time that each look is charged in lockstep, in s."""
        self._chain = chain
        self._robot = robot
        self._looker = looker
        self._eyes = eyes
        self._settings = settings
        self._thinking = thinking
        self._job = job
        self._album = album
        self._looks: list[ReachLook] = []

    def execute(self, target: ImagePoint | str, *, one_look: bool, gaze: bool = False) -> None:
        """Brings the hand to `target`, a point or an object's name; with `gaze` the head turns to the object before.

        `NotSeen` when object or hand is not found, `OutsideTaughtRegion` when support is low, `NotReached` when it does
        not converge. With one look only it goes the whole way at once and does not check.
        """
        state, pair = self._looker.look()
        goal = self._goal(pair, self._eyes.find(pair, target) if isinstance(target, str) else target)
        if gaze:
            self._turn_to(goal.seen, pair.head.pan, pair.head.tilt)
            state, pair = self._looker.look()
            goal = self._found_again(pair, goal, target)
        aim: ArmPoint | None = None
        looks = 1 if one_look else self._settings.max_looks
        for number in range(looks):
            self._job.check()
            if number:
                state, pair = self._looker.look()
                with suppress(NotSeen):  # the hand is before it: then it is where it was
                    goal = self._found_again(pair, goal, target)
            hand = self._hand(pair)
            here, seen = self._chain.to_arm(hand, _head(pair))
            away = goal.place.array() - here.array()
            distance = float(np.linalg.norm(away))
            last = number == looks - 1 and not one_look
            enough = self._settings.acceptable if last else self._settings.tolerance
            if last or (distance <= enough and not one_look):
                self._record(pair, goal.seen, hand, distance, None, (*goal.answers, *seen), ())
                if distance <= enough:
                    return
                break
            share = 1.0 if one_look or distance <= self._settings.far else self._settings.part
            missed = np.zeros(3) if aim is None else self._bounded(aim.array() - here.array())
            aim = ArmPoint(here.array() + missed + share * away)
            turn, said = self._chain.to_joints(aim, JointAngles(state.joints))
            answers = (*goal.answers, *seen, said)
            if refusal := self._refusal(turn, answers):
                self._record(pair, goal.seen, hand, distance, turn, answers, ())
                raise refusal
            moved = self._move(state, turn)
            self._record(pair, goal.seen, hand, distance, turn, answers, moved)
        if not one_look:
            raise NotReached(
                f"The hand is seen {1e3 * self._looks[-1].away:.1f} mm from where it should be after {looks} looks; "
                f"{1e3 * self._settings.acceptable:.1f} mm are acceptable. Collect more samples near this place."
            )

    def _goal(self, pair: StereoPair, point: ImagePoint) -> _Goal:
        return _Goal(point, *self._chain.to_arm(point, _head(pair)))

    def _found_again(self, pair: StereoPair, known: _Goal, target: ImagePoint | str) -> _Goal:
        """Where the goal is now, if it is an object; raises `NotSeen`."""
        if not isinstance(target, str):
            return known
        now = self._goal(pair, self._eyes.find(pair, target))
        moved = float(np.linalg.norm(now.place.array() - known.place.array()))
        return now if moved > self._settings.moved else replace(known, seen=now.seen)

    def _turn_to(self, point: ImagePoint, pan: float, tilt: float) -> None:
        """Active vision: one saccade, by SCS, from (pan, tilt) in rad to what is seen at `point`."""
        turn, said = self._chain.to_head(point, tilt)
        require_support(said, point, tilt, self._settings.least_support)
        self._looker.turn(HeadAngles(pan + turn.pan, tilt + turn.tilt))

    def _bounded(self, missed: Floats) -> Floats:
        """What the arm did not do of what it was sent to do, (3,) in m, to be made up for; not without end."""
        length = float(np.linalg.norm(missed))
        return missed * min(1.0, self._settings.largest_correction / length) if length else missed

    def _hand(self, pair: StereoPair) -> ImagePoint:
        try:
            return self._eyes.find(pair, None)
        except NotSeen as missing:
            picture = self._album.picture(side_by_side(pair.left.image, pair.right.image, missing))
            data = {"message": str(missing), "picture": picture.path}
            self._job.publish("not_seen", data, self._result(), picture.keep)
            raise

    def _refusal(self, turn: JointDifference, answers: tuple[Said, ...]) -> Exception | None:
        """Why the arm must not be moved by these answers; None when it may be."""
        least = min(answers, key=lambda said: said.answer.support)
        if least.answer.support < self._settings.least_support:
            return OutsideTaughtRegion(
                f"Module '{least.module}' was not taught here (support {least.answer.support:.2f}, at least "
                f"{self._settings.least_support:.2f} is asked for): collect samples of it in this region."
            )
        return too_far("module 'AJS'", turn, self._settings.largest_move)

    def _move(self, before: RobotState, turn: JointDifference) -> tuple[float, ...]:
        if self._robot.lockstep:
            self._robot.wait(self._thinking)
        after = self._robot.adjust_joints(turn.angles)
        return tuple(float(value) for value in after.joints - before.joints)

    def _record(
        self,
        pair: StereoPair,
        target: ImagePoint,
        hand: ImagePoint,
        away: float,
        turn: JointDifference | None,
        answers: tuple[Said, ...],
        moved: tuple[float, ...],
    ) -> None:
        picture = self._album.picture(side_by_side(pair.left.image, pair.right.image, ImagePair(target, hand)))
        look = ReachLook(
            number=picture.number,
            world_time=pair.left.world_time,
            target=(target.row, target.column, target.disparity),
            hand=(hand.row, hand.column, hand.disparity),
            away=away,
            delta=() if turn is None else tuple(turn.angles.tolist()),
            moved=moved,
            answers=tuple(map(_answer_record, answers)),
            picture=picture.path,
        )
        self._looks.append(look)
        self._job.publish("look", look.model_dump(mode="json"), self._result(), picture.keep)

    def _result(self) -> ReachResult:
        return ReachResult(looks=tuple(self._looks))


def _head(pair: StereoPair) -> HeadAngles:
    return HeadAngles(pair.head.pan, pair.head.tilt)


def _answer_record(said: Said) -> AnswerRecord:
    return AnswerRecord(
        module=said.module,
        support=said.answer.support,
        neighbours=NeighbourRecord.nearest_of(said.answer, _NEIGHBOURS_RECORDED),
    )
