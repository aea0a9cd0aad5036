"""What each module learns from a posture of the babbling arm."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from handeye.modules import ajs, cas, ijs
from handeye.modules.recognition import NotSeen
from handeye.modules.spaces import ArmPoint, Floats, HeadAngles, ImagePoint, ImageVector, JointAngles
from handeye.robot_bridge.driver import RobotState
from handeye.rpc.errors import OutOfLimits
from handeye.server.chain import Chain
from handeye.server.collecting.gathering import Gathering
from handeye.server.eyes import Eyes
from handeye.server.looking import Looker

_PAIRS = 4  # with earlier postures, for each posture
_ASIDE = (0.2, 0.22)  # rad of pan and tilt that the head looks beside the hand
_SEARCH = [(0.0, 0.0), *((0.25 * np.cos(a), 0.2 * np.sin(a)) for a in np.arange(8) * np.pi / 4)]  # rad


class Pupil(Protocol):
    """A module that learns from postures."""

    module: str

    def learn(self, state: RobotState, name: str) -> bool:
        """Learns from the arm at rest in a new posture of that name; False when there was nothing to learn."""
        ...


class AjsPupil:
    """AJS: from each of some earlier postures to this one it is so far."""

    module = "AJS"

    def __init__(self, gathering: Gathering, random: np.random.Generator) -> None:
        self._gathering = gathering
        self._random = random
        self._joints: list[Floats] = []

    def learn(self, state: RobotState, name: str) -> bool:
        """Always learns, but from the first posture."""
        if self._joints:
            earlier = [self._joints[i] for i in _some(len(self._joints), self._random)]
            point = ArmPoint(state.point)
            self._gathering.add(
                self.module,
                np.array([ajs.input_vector(point, JointAngles(joints)) for joints in earlier]),
                np.array([state.joints - joints for joints in earlier]),
                [name] * len(earlier),
            )
        self._joints.append(state.joints.copy())
        return True


class CasPupil:
    """CAS: where the hand is seen from several poses of the head, and what the arm makes of its joint readings."""

    module = "CAS"

    def __init__(
        self, gathering: Gathering, chain: Chain, looker: Looker, eyes: Eyes, random: np.random.Generator, looks: int
    ) -> None:
        """CSS and SCS must have been taught before; `looks` at each posture."""
        self._gathering = gathering
        self._chain = chain
        self._looker = looker
        self._eyes = eyes
        self._random = random
        self._count = looks
        self._centred = HeadAngles(looker.head.pan, looker.head.tilt)
        """Where the head has, or would have, the hand in the middle that was seen last; at first, where it points."""

    def learn(self, state: RobotState, name: str) -> bool:
        """Looks at the hand from here, and from poses around the one that would centre it."""
        first = self._find()
        if first is None:
            self._gathering.reject("hand not found")
            return False
        seen = [first]
        point, head = first
        turn, _ = self._chain.to_head(point, head.tilt)
        self._centred = HeadAngles(head.pan + turn.pan, head.tilt + turn.tilt)
        for _ in range(self._count - 1):
            look = self._see(_beside(self._centred, *(self._random.uniform(-1.0, 1.0, 2) * _ASIDE)))
            if look is None:
                self._gathering.reject("hand not seen")
            else:
                seen.append(look)
        inputs = [cas.input_vector(self._chain.to_camera(point)[0], head) for point, head in seen]
        self._gathering.add(self.module, np.array(inputs), np.tile(state.point, (len(seen), 1)), [name] * len(seen))
        return True

    def _find(self) -> tuple[ImagePoint, HeadAngles] | None:
        """The hand from where it was in the middle last, or from around there; None when it is not seen."""
        places = (_beside(self._centred, *aside) for aside in _SEARCH)
        return next((seen for place in places if (seen := self._see(place)) is not None), None)

    def _see(self, at: HeadAngles) -> tuple[ImagePoint, HeadAngles] | None:
        """The hand from a pose of the head; None when it is not seen from there."""
        try:
            self._looker.turn(at)
        except OutOfLimits:
            return None
        _, pair = self._looker.look()
        try:
            return self._eyes.find(pair, None), HeadAngles(pair.head.pan, pair.head.tilt)
        except NotSeen:
            return None


class IjsPupil:
    """IJS: from each of some earlier postures the hand moved so far in the picture, and the joints so far.

    The head stays as it stands: IJS knows pictures of one pose of it only.
    """

    module = "IJS"

    def __init__(self, gathering: Gathering, looker: Looker, eyes: Eyes, random: np.random.Generator) -> None:
        self._gathering = gathering
        self._looker = looker
        self._eyes = eyes
        self._random = random
        self._head = looker.head
        self._postures: list[tuple[ImagePoint, Floats]] = []

    def learn(self, state: RobotState, name: str) -> bool:
        """Looks once."""
        if (self._looker.head.pan, self._looker.head.tilt) != (self._head.pan, self._head.tilt):
            self._looker.turn(HeadAngles(self._head.pan, self._head.tilt))
        _, pair = self._looker.look()
        try:
            hand = self._eyes.find(pair, None)
        except NotSeen:
            self._gathering.reject("hand not seen")
            return False
        if self._postures:
            earlier = [self._postures[i] for i in _some(len(self._postures), self._random)]
            self._gathering.add(
                self.module,
                np.array([ijs.input_vector(0, _way(point, hand), JointAngles(joints)) for point, joints in earlier]),
                np.array([state.joints - joints for _, joints in earlier]),
                [name] * len(earlier),
            )
        self._postures.append((hand, state.joints.copy()))
        return True


def _beside(head: HeadAngles, pan: float, tilt: float) -> HeadAngles:
    return HeadAngles(head.pan + pan, head.tilt + tilt)


def _way(hand: ImagePoint, to: ImagePoint) -> ImageVector:
    return ImageVector(to.row - hand.row, to.column - hand.column, to.disparity - hand.disparity)


def _some(count: int, random: np.random.Generator) -> list[int]:
    """The newest of `count` things and some of the others."""
    others = random.permutation(count - 1)[: _PAIRS - 1].tolist() if count > 1 else []
    return [count - 1, *others]
