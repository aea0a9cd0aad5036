"""The way of the data, one short function for each arrow. The page to read first.

    images --RSS--> I --ASM--> I' --CSS--> C --CAS--> A --AJS--> Δθ --> robot      the long way
                    |    |             (and T)   (and θ)
                    |    `---> I' --IJS--> Δθ --> robot                              the short cut
                    `--SCS--> S --> head

* Images: left and right, (rows, columns, 3) uint8.
* I (`ImagePair`): where object and hand are in the stereo image, two points (row, column, disparity) in px.
* I': the action. For the long way the point where the hand is to be (`ImagePoint`); for the short cut, and only for it,
  the way from hand to object: in px (`ImageVector`), or, where CSS was taught, in the hand's own axes (`HandVector`).
* C (`CameraPoint`): that point in the camera's frame, in m.
* A (`ArmPoint`): in the arm's frame, in m; T (`HeadAngles`), where the head points, goes with it.
* Δθ (`JointDifference`): how far each joint is to turn, in rad; the joints as they are go with it.
* S (`HeadTurn`): how far the head is to turn to centre a point, in rad.

RSS, recognition and segmentation, finds things. ASM, action specification, says what is to be done about them. The
others are learned: CSS, CAS and AJS (thesis 3.1), the single IJS that replaces them in the thesis's real experiments
(4.2.5), and SCS. Nothing on these ways knows where the cameras or the arm stand, nor how an arm is built: what they
need of that is in the samples. `handeye.server.executor` goes the short cut once for each look, `handeye.server.reach`
the long way.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from handeye.modules import ajs as _ajs
from handeye.modules import asm as _asm
from handeye.modules import cas as _cas
from handeye.modules import scs as _scs
from handeye.modules.answers import Answer
from handeye.modules.ijs import input_vector
from handeye.modules.module import Module
from handeye.modules.spaces import (
    ArmPoint,
    CameraPoint,
    HandVector,
    HeadAngles,
    HeadTurn,
    ImagePair,
    ImagePoint,
    ImageVector,
    JointAngles,
    JointDifference,
)

Image = NDArray[np.uint8]


class Sees(Protocol):
    """RSS: what finds an object by its name, and the hand, in two images.

    `handeye.modules.guided.GuidedRecogniser` does; it raises `NotSeen` when one of them is not to be found.
    """

    def see(self, left: Image, right: Image, name: str, head: HeadAngles, /) -> ImagePair:
        """Where object and hand are; `head` pointed there."""
        ...


def recognise(recogniser: Sees, left: Image, right: Image, object_name: str, head: HeadAngles) -> ImagePair:
    """RSS: two images, and where the head pointed -> I."""
    return recogniser.see(left, right, object_name, head)


def specify_action(found: ImagePair, css: Module | None = None) -> ImageVector | HandVector:
    """ASM: I -> I', the vector from hand to object (Fig 3.2); in the hand's own axes when CSS is given."""
    return _asm.in_picture(found) if css is None else _asm.in_hand(css, found)


def image_to_joints(
    ijs: Module, subtask: int, action: ImageVector | HandVector, joints: JointAngles
) -> tuple[JointDifference, Answer]:
    """IJS: the subtask's number, I' and the joints -> Δθ, and the answer it was taken from.

    Raises `NotTaught` when the subtask was never shown.
    """
    answer = ijs.answer(input_vector(subtask, action, joints))
    return JointDifference(answer.output), answer


def image_to_camera(css: Module, point: ImagePoint) -> tuple[CameraPoint, Answer]:
    """CSS: a point of the stereo image -> C, and the answer it was taken from. `NotTaught` without samples."""
    answer = css.answer(point.array())
    return CameraPoint(answer.output), answer


def camera_to_arm(cas: Module, point: CameraPoint, head: HeadAngles) -> tuple[ArmPoint, Answer]:
    """CAS: C and T -> A, and the answer it was taken from. `NotTaught` without samples."""
    answer = cas.answer(_cas.input_vector(point, head))
    return ArmPoint(answer.output), answer


def arm_to_joints(ajs: Module, point: ArmPoint, joints: JointAngles) -> tuple[JointDifference, Answer]:
    """AJS: A and the joints -> Δθ, and the answer it was taken from. `NotTaught` without samples."""
    answer = ajs.answer(_ajs.input_vector(point, joints))
    return JointDifference(answer.output), answer


def image_to_head(scs: Module, point: ImagePoint, tilt: float) -> tuple[HeadTurn, Answer]:
    """SCS: a point of the stereo image and the head's tilt in rad -> S, and the answer it was taken from.

    `NotTaught` without samples.
    """
    answer = scs.answer(_scs.input_vector(point, tilt))
    pan, tilt_turn = answer.output.tolist()
    return HeadTurn(pan, tilt_turn), answer
