"""Where the hand is while something hides it: by the joints, as one knows of a hand that one does not see."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from handeye.modules.declaration import ApproximatorSettings, Component, ModuleDeclaration, Output
from handeye.modules.ijs import JOINTS
from handeye.modules.module import Module
from handeye.modules.spaces import Floats, HandPoint, ImagePoint
from handeye.robot_bridge.driver import Joints
from handeye.server.demonstration import Demonstration

_CORNERS = 4
_LEAST_SUPPORT = 0.2

_DECLARATION = ModuleDeclaration(
    name="felt hand",
    inputs=tuple(Component(name=f"joint {i}", unit="rad", scale=0.15) for i in range(1, JOINTS + 1)),
    outputs=tuple(
        Output(name=f"{axis} {place}", unit="px")
        for place in ("middle", *(f"corner {i}" for i in range(1, _CORNERS + 1)))
        for axis in ("row", "column", "disparity")
    ),
    approximator=ApproximatorSettings(method="local_quadratic", neighbours=None, ridge=1e-5, curvature_ridge=1e-2),
)


class FeltHand:
    """Learned from the looks of demonstrations, and set right by the last look in which the hand was seen.

    So it holds also when the head stands otherwise now, or joints read wrong.
    """

    def __init__(self, demonstrations: Callable[[], Sequence[Demonstration]]) -> None:
        """They are asked for when the hand is not seen for the first time."""
        self._demonstrations = demonstrations
        self._module: Module | None = None
        self._seen: tuple[Joints, ImagePoint] | None = None

    def notice(self, joints: Joints, seen: ImagePoint) -> None:
        """The hand was seen there, with the joints (6,) at so many rad."""
        self._seen = joints, seen

    def at(self, joints: Joints) -> ImagePoint | None:
        """Where the hand is in the stereo image.

        None when it was never seen before, when it was not where it was in the demonstrations, or when they had it
        nowhere near.
        """
        if self._seen is None:
            return None
        if self._module is None:
            self._module = _learned(self._demonstrations())
        if not self._module.samples:
            return None
        then, seen = self._seen
        before, now = self._module.answer(then), self._module.answer(joints)
        if min(before.support, now.support) < _LEAST_SUPPORT:
            return None
        moved = (now.output - before.output).reshape(1 + _CORNERS, 3)
        row, column, disparity = (seen.array() + moved[0]).tolist()
        if not isinstance(seen, HandPoint):
            return ImagePoint(row, column, disparity)
        return HandPoint(row, column, disparity, tuple(map(tuple, (np.array(seen.outline) + moved[1:]).tolist())))


def _learned(demonstrations: Sequence[Demonstration]) -> Module:
    module = Module(_DECLARATION)
    looks = [
        (look.joints, _numbers(look.found.hand), each.id)
        for each in demonstrations
        for look in each.observations
        if look.found is not None
    ]
    if looks:
        joints, places, names = zip(*looks, strict=True)
        module.learn(np.array(joints), np.array(places), names)
    return module


def _numbers(hand: ImagePoint) -> Floats:
    """(15,): the point, and its corners; of a hand that was seen as a point these are the point too."""
    corners = hand.outline if isinstance(hand, HandPoint) else (hand.array(),) * _CORNERS
    return np.concatenate([hand.array(), *map(np.asarray, corners)])
