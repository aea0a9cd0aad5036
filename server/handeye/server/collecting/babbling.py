"""Samples for AJS, CAS and IJS by babbling: the arm makes small motions of its own and looks where its hand comes.

Joints that are moved together along few directions keep the hand's posture (`synergies`); within them the arm first
moves at random and then towards points of the region by what it has learned so far (goal babbling: Rolf, Steil and
Gienger, "Goal babbling permits direct learning of inverse kinematics", 2010), which covers the region evenly. It knows
nothing of how the arm is built: a motion that the robot refuses is another one's turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handeye.modules.spaces import ArmPoint, Floats, JointAngles
from handeye.robot_bridge.driver import RobotState
from handeye.rpc.errors import OutOfLimits, Unreachable
from handeye.server.acting import ActingRobot
from handeye.server.answering import NothingTaught
from handeye.server.chain import Chain
from handeye.server.collecting.gathering import Gathering
from handeye.server.collecting.pupils import Pupil
from handeye.server.job import Job
from handeye.server.problem import Conflict

_FIRST = 12  # postures before AJS is asked for the way to a goal
_SMALL = 0.15  # rad along each synergy, at random
_LARGEST = 0.35  # rad that one motion turns a joint at most
_NOISE = 0.02  # rad along each synergy on the way to a goal
_BEYOND = 0.03  # m that the hand may be outside of the region
_PATIENCE = 60  # motions in a row that came to nothing


class NoPostures(Conflict):
    """The arm finds no more postures in the region."""

    code = "no_postures"


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """Where the arm's point may be while it babbles: a box in the arm's frame, corners (3,) in m."""

    lower: Floats
    upper: Floats

    def has(self, point: Floats, margin: float) -> bool:
        """Whether a point is inside, or at most `margin` m outside."""
        return bool((point >= self.lower - margin).all() and (point <= self.upper + margin).all())


class Babbling:
    """Visits postures and has pupils learn from each. `execute` may be called once."""

    def __init__(
        self,
        robot: ActingRobot,
        chain: Chain,
        region: Region,
        synergies: Floats,
        pupils: list[Pupil],
        gathering: Gathering,
        job: Job,
        random: np.random.Generator,
    ) -> None:
        """`synergies` (s, joints): directions in joint space along which it moves."""
        self._robot = robot
        self._chain = chain
        self._region = region
        self._synergies = synergies / np.abs(synergies).max(axis=1, keepdims=True)
        self._pupils = pupils
        self._gathering = gathering
        self._job = job
        self._random = random
        self._in_vain = 0

    def execute(self, visited: int, postures: int) -> None:
        """Goes on until so many `postures` were visited, of which some were `visited` at earlier times."""
        while visited < postures:
            state = self._next(visited)
            name = f"posture-{visited + 1}"
            # Every pupil has a look at it, even when one has nothing to learn from it.
            if sum([pupil.learn(state, name) for pupil in self._pupils]):
                visited += 1
                self._in_vain = 0
                self._job.publish("posture", {"posture": visited}, self._gathering.result)
                self._job.report(visited / postures)
            else:
                self._came_to_nothing("nothing learned")

    def _next(self, visited: int) -> RobotState:
        """Moves to another posture inside the region."""
        while True:
            self._job.check()
            before = self._robot.at_rest()
            motion = self._motion(before, at_random=visited < _FIRST or self._in_vain % 2 == 1)
            try:
                self._robot.adjust_joints(motion)
            except (OutOfLimits, Unreachable):
                self._came_to_nothing("refused by the robot")
                continue
            state = self._robot.at_rest()
            if self._region.has(state.point, _BEYOND) or self._nears(before, state):
                return state
            self._came_to_nothing("outside of the region")
            self._robot.adjust_joints(before.joints - state.joints)

    def _motion(self, state: RobotState, *, at_random: bool) -> Floats:
        """(joints,) rad."""
        joints = JointAngles(state.joints)
        along = self._random.uniform(-_SMALL, _SMALL, len(self._synergies))
        if not at_random:
            goal = ArmPoint(self._random.uniform(self._region.lower, self._region.upper))
            try:
                turn, _ = self._chain.to_joints(goal, joints)
            except NothingTaught:  # AJS is not among those that learn here
                pass
            else:
                towards = np.linalg.lstsq(self._synergies.T, turn.angles, rcond=None)[0]
                along = towards + self._random.normal(0.0, _NOISE, len(towards))
        motion: Floats = along @ self._synergies
        return motion * min(1.0, _LARGEST / float(np.abs(motion).max()))

    def _nears(self, before: RobotState, after: RobotState) -> bool:
        """The arm began outside of the region and is nearer to it now."""
        return self._outside(after) < self._outside(before)

    def _outside(self, state: RobotState) -> float:
        """How far the arm's point is outside of the region, in m."""
        nearest = np.clip(state.point, self._region.lower - _BEYOND, self._region.upper + _BEYOND)
        return float(np.linalg.norm(state.point - nearest))

    def _came_to_nothing(self, reason: str) -> None:
        self._gathering.reject(reason)
        self._in_vain += 1
        if self._in_vain >= _PATIENCE:
            raise NoPostures(
                f"{_PATIENCE} motions in a row came to nothing (the last one: {reason}). Move the arm to a posture in "
                "the region in which its hand is seen, or ask for another region."
            )
