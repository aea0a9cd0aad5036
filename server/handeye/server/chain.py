"""The long way of the data as it is taught now: CSS, CAS and AJS one after the other, and SCS beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from handeye.modules import ajs, cas, css, ijs, pipeline, scs
from handeye.modules.answers import Answer
from handeye.modules.declaration import ModuleDeclaration
from handeye.modules.module import Module
from handeye.modules.spaces import ArmPoint, CameraPoint, HeadAngles, HeadTurn, ImagePoint, JointAngles, JointDifference
from handeye.rpt import NotTaught
from handeye.server.answering import NothingTaught
from handeye.server.livemodules import LiveModules
from handeye.server.problem import NotFound

T = TypeVar("T")

_DECLARATIONS: dict[str, ModuleDeclaration] = {
    each.DECLARATION.name: each.DECLARATION for each in (css, cas, ajs, scs, ijs)
}


@dataclass(frozen=True, slots=True)
class Said:
    """An answer on the way, and the module that gave it."""

    module: str
    answer: Answer


class Chain:
    """Answers of the modules named CSS, CAS, AJS and SCS.

    Each method raises `NothingTaught` when a module that it asks is not there or was taught nothing.
    """

    def __init__(self, modules: LiveModules) -> None:
        self._modules = modules

    def to_camera(self, point: ImagePoint) -> tuple[CameraPoint, Said]:
        """CSS: where a point of the stereo image is in the camera's frame."""
        camera, said = self._ask("CSS", lambda module: pipeline.image_to_camera(module, point))
        return camera, Said("CSS", said)

    def to_arm(self, point: ImagePoint, head: HeadAngles) -> tuple[ArmPoint, tuple[Said, ...]]:
        """CSS and CAS: where the arm's point is when the hand is seen at `point` with the head at `head`."""
        camera, seen = self.to_camera(point)
        arm, placed = self._ask("CAS", lambda module: pipeline.camera_to_arm(module, camera, head))
        return arm, (seen, Said("CAS", placed))

    def to_joints(self, point: ArmPoint, joints: JointAngles) -> tuple[JointDifference, Said]:
        """AJS: how far each joint is to turn so that the arm's point comes to `point`."""
        turn, said = self._ask("AJS", lambda module: pipeline.arm_to_joints(module, point, joints))
        return turn, Said("AJS", said)

    def to_head(self, point: ImagePoint, tilt: float) -> tuple[HeadTurn, Said]:
        """SCS: how far the head, at `tilt` rad, is to turn to centre `point`."""
        turn, said = self._ask("SCS", lambda module: pipeline.image_to_head(module, point, tilt))
        return turn, Said("SCS", said)

    def require(self, *names: str) -> None:
        """Raises `NothingTaught` unless all of these modules can answer."""
        for name in names:
            self._ask(name, _require_samples)

    def _ask(self, name: str, ask: Callable[[Module], T]) -> T:
        try:
            return ask(self._modules.live(name))
        except (NotFound, NotTaught) as error:
            raise NothingTaught(
                f"Module '{name}' was taught nothing yet; let it be taught by `handeye collect {name}`."
            ) from error


def _require_samples(module: Module) -> None:
    if not module.samples:
        raise NotTaught


def declaration_of(name: str) -> ModuleDeclaration:
    """How a module of the hand-eye system is declared. `KeyError` for another name."""
    return _DECLARATIONS[name]
