"""The acting loop: look, answer, move, look again, until aligned; then the subtask's gripper action.

Thesis 4.2: the subtasks, what they are towards and their gripper actions come from the demonstrations, every motion
from module IJS. The thesis answers once per subtask (`one_look`); looking again and again closes the loop it left open
(4.3, 5.4). Where looking is impossible, as while a cup is tilted, a way was shown that goes on from the goal: it is
answered from the last look, all of it at once, and followed in the time that it took.
"""

from __future__ import annotations

import numpy as np
import structlog

from handeye.camera_bridge.driver import StereoPair
from handeye.modules.recognition import HandNotSeen, NotSeen
from handeye.modules.spaces import ImagePair
from handeye.robot_bridge.driver import Joints, RobotState
from handeye.rpc.errors import OutOfLimits, RpcError
from handeye.server.acting import ActingRobot, ActingSettings, OutsideTaughtRegion, too_far
from handeye.server.album import Album, Picture
from handeye.server.demonstration import Subtask
from handeye.server.eyes import Eyes, Sighting
from handeye.server.felt import FeltHand
from handeye.server.goals import Goals
from handeye.server.grip import Grip, LostGrip
from handeye.server.job import Job
from handeye.server.looking import Looker
from handeye.server.pictures import side_by_side
from handeye.server.problem import Conflict
from handeye.server.runrecord import RunRecord
from handeye.server.skill import Skill, SkillAnswer

log = structlog.get_logger(__name__)

_NOWHERE = 0.0005  # m: an arm that is stretched out turns its elbow and brings the hand no further than this ...
_STRETCHED = 5.0  # ... so what answers ask for there, up to so many times what is acceptable, does not matter


class NotAligned(Conflict):
    """The looks have run out and the hand is not where the subtask ends: the gripper must not act there."""

    code = "not_aligned"


class Run:
    """One execution of a trained task. `execute` may be called once."""

    def __init__(
        self,
        skill: Skill,
        object_name: str,
        robot: ActingRobot,
        looker: Looker,
        eyes: Eyes,
        settings: ActingSettings,
        job: Job,
        album: Album,
        felt: FeltHand,
        *,
        one_look: bool,
    ) -> None:
        self._skill = skill
        self._object = object_name
        self._robot = robot
        self._looker = looker
        self._eyes = eyes
        self._settings = settings
        self._job = job
        self._album = album
        self._one_look = one_look
        self._record = RunRecord(job, robot.beat)
        self._felt = felt
        self._last_look: tuple[ImagePair, Joints]
        self._goals = Goals(settings.noise)
        self._grip = Grip(robot, settings)

    def execute(self) -> None:
        """Does the task. On any error the arm is stopped, the subtask is marked as failed, the error goes on.

        Before that it is begun again, as often as is set, when what was seen was not as taught.
        """
        with self._record:
            self._execute()

    def _execute(self) -> None:
        try:
            start = self._robot.state().joints
            attempts = 1 if self._one_look else self._settings.attempts
            for left in reversed(range(attempts)):
                begun = self._record.subtasks
                self._grip.lets_go = left > 0
                try:
                    return self._attempt()
                except (OutsideTaughtRegion, NotSeen, NotAligned, LostGrip) as trouble:
                    # In the first subtask it would end in the same way.
                    if not left or self._record.subtasks - begun < 2:
                        raise
                    self._begin_again(start, trouble)
        except Exception as error:
            self._stop(str(error))
            self._record.failed()
            raise

    def _attempt(self) -> None:
        last = self._skill.subtasks[-1]
        for subtask in self._skill.subtasks:
            self._do(subtask, final=subtask is last and not _goes_on(subtask))
        self._robot.wait(self._settings.hold)
        self._grip.require()

    def _begin_again(self, start: Joints, trouble: Exception) -> None:
        """Puts back what is held, opens the gripper and goes back to where the arm was at first."""
        self._record.failed()
        self._record.again(trouble)
        self._record.settle()
        self._grip.go_back()
        self._robot.adjust_joints(start - self._robot.at_rest().joints)

    def _do(self, subtask: Subtask, *, final: bool) -> None:
        """`final`: nothing follows."""
        started = self._robot.state().world_time
        self._record.begun(subtask.name, self._towards(subtask), started)
        self._goals.forget()
        try:
            aligned = self._align(subtask, self._settings.last_tolerance if final else self._settings.tolerance)
        except NotSeen:
            # Nothing is left but to see that it is well. What hides it does not take it out of the fingers.
            if not (final and self._grip.holds()):
                raise
            aligned = False
        self._record.settle()
        if subtask.way:
            self._follow(subtask)
        if subtask.action == "close_gripper":
            self._grip.close()
        elif subtask.action == "open_gripper":
            self._grip.open()
        ended = self._robot.state().world_time
        self._record.succeeded(ended, aligned, subtask.action)

    def _align(self, subtask: Subtask, tolerance: float) -> bool:
        """Looks and moves until the answer is within `tolerance` (rad); False when the looks ran out first.

        `NotAligned` when they did, a way or a gripper action comes next and the last answer was not acceptable either:
        a gripper acts only where it was shown to. With one look only there is nothing to check by: it moves by the one
        answer and acts, as the thesis does.
        """
        looks = 1 if self._one_look else self._settings.max_looks
        remaining = way = 0.0
        for _ in range(looks):
            remaining, way = self._step(subtask, tolerance)
            if remaining <= tolerance:
                return True
        acceptable = self._settings.acceptable if way > _NOWHERE else _STRETCHED * self._settings.acceptable
        if _goes_on(subtask) and not self._one_look and remaining > max(acceptable, tolerance):
            raise NotAligned(
                f"Subtask '{subtask.name}' is not aligned after {looks} looks: by what was seen a joint is still to "
                f"turn by {remaining:.4f} rad, {max(acceptable, tolerance):.4f} rad is acceptable. Show more "
                "demonstrations near this place, or allow more looks."
            )
        return False

    def _step(self, subtask: Subtask, tolerance: float) -> tuple[float, float]:
        """One look and, unless it is within `tolerance`, the move it asks for.

        Returns the answer's largest angle in rad, and how far the hand has come by it, in m; of an arm that has not
        gone it, infinitely far.
        """
        self._job.check()
        self._grip.require()
        state, sighting, found, picture = self._look(self._towards(subtask))
        self._last_look = (found, state.joints)
        told = self._skill.answer(subtask.name, found, state.joints)
        if refusal := self._refusal(subtask.name, found, told):
            self._record.look(picture, sighting, found, told)
            raise refusal
        if self._robot.lockstep:
            self._robot.wait(self._settings.thinking)
        self._record.settle()
        way = self._goals.mean(state.joints, told.turn.angles) - state.joints
        largest = float(np.max(np.abs(way)))
        after = self._move(state, way) if largest > tolerance else state
        turned = after.joints - state.joints
        self._record.look(picture, sighting, found, told, None if after is state else turned)
        went = float(np.linalg.norm(after.point - state.point))
        return largest, went if np.max(np.abs(turned)) > largest / 2 else np.inf

    def _follow(self, subtask: Subtask) -> None:
        """Goes along the subtask's way without looking; where it has been sooner than was shown, it waits."""
        found, joints = self._last_look
        answers = [self._skill.answer(subtask.name, found, joints, number) for number in range(len(subtask.way))]
        for told in answers:  # a way that cannot be gone to its end is not begun
            if refusal := self._refusal(subtask.name, found, told):
                raise refusal
        for told, seconds in zip(answers, subtask.way, strict=True):
            self._job.check()
            self._grip.require()
            before = self._robot.state()
            after = self._grip.carry(before.joints, joints + told.turn.angles - before.joints, seconds)
            early = seconds - (after.world_time - before.world_time)
            if early > 0.0:
                self._robot.wait(early)
            self._record.waypoint(told, seconds, after.joints - before.joints)

    def _towards(self, subtask: Subtask) -> str:
        """The object that a subtask is towards."""
        return self._object if subtask.object is None else subtask.object

    def _look(self, towards: str) -> tuple[RobotState, Sighting, ImagePair, Picture]:
        """The state at rest, and a pair that shows it; raises `NotSeen` when object or hand is not found."""
        state, pair = self._looker.look()
        sighting = self._recognise(pair, towards, state.joints)
        picture = self._album.picture(side_by_side(pair.left.image, pair.right.image, sighting.found))
        if isinstance(sighting.found, NotSeen):
            self._record.not_seen(picture, sighting.found)
            raise sighting.found
        return state, sighting, sighting.found, picture

    def _recognise(self, pair: StereoPair, towards: str, joints: Joints) -> Sighting:
        """Object and hand; a hand that is hidden is where the joints have it."""
        sighting = self._eyes.recognise(pair, towards)
        if isinstance(sighting.found, ImagePair):
            self._felt.notice(joints, sighting.found.hand)
        elif isinstance(sighting.found, HandNotSeen) and (hand := self._felt.at(joints)) is not None:
            try:
                object_at, confidence = self._eyes.see(pair, towards)
                return Sighting(pair, ImagePair(object_at, hand, confidence, 0.0))
            except NotSeen as missing:
                return Sighting(pair, missing)
        return sighting

    def _refusal(self, subtask: str, found: ImagePair, told: SkillAnswer) -> Exception | None:
        """Why the robot must not be moved by this answer; None when it may be."""
        if told.support >= self._settings.least_support:
            return too_far(f"subtask '{subtask}'", told.turn, self._settings.largest_move)
        low = f"(support {told.support:.2f}, at least {self._settings.least_support:.2f} is asked for)"
        if told.seen < self._settings.least_support:
            return OutsideTaughtRegion(
                f"Module 'CSS' was not taught where object and hand are seen {low}: show it grids there by "
                "`handeye collect CSS`, or train the task in the picture's axes."
            )
        at = found.object
        return OutsideTaughtRegion(
            f"Subtask '{subtask}' is outside the taught region {low}. The nearest demonstration is "
            f"'{told.answer.neighbours[0].demonstration}'; show one with the object where it is seen now, at row "
            f"{at.row:.0f}, column {at.column:.0f}, disparity {at.disparity:.0f}."
        )

    def _move(self, before: RobotState, way: Joints) -> RobotState:
        """Goes, and returns where it came; half of the way when the robot refuses the whole: an answer is least sure of
        its far end."""
        try:
            return self._grip.carry(before.joints, way)
        except OutOfLimits:
            return self._grip.carry(before.joints, way / 2)

    def _stop(self, reason: str) -> None:
        """Stops the arm if its bridge can be reached; else the bridge brakes by itself, for want of heartbeats."""
        try:
            self._robot.stop(f"task ended early: {reason}")
        except RpcError as error:
            log.warning("the robot could not be told to stop", job=self._job.id, error=str(error))
            self._record.stop(str(error), stopped=False)
        else:
            self._record.stop(reason, stopped=True)


def _goes_on(subtask: Subtask) -> bool:
    """Something follows the subtask's goal that nobody looks at: its way, or what the gripper does."""
    return bool(subtask.way or subtask.action)
