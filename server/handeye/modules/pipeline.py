"""The way of the data, one short function for each arrow. The page to read first.

    images --RSS--> I --ASM--> I' --IJS--> Δθ --> robot

* Images: left and right, (rows, columns, 3) uint8.
* I (`ImagePair`): where object and hand are in the stereo image, two points (row, column, disparity) in px.
* I' (`ImageVector`): the action, as the way from hand to object in the stereo image, in px.
* Δθ (`JointDifference`): how far each joint is to turn, in rad.

The acting loop of `handeye.server.executor` goes this way once for each look.

RSS, recognition and segmentation, finds things. ASM, action specification, says what is to be done about them; the
subtask goes with it. IJS, image to joints, is the learned module that the thesis used in its real experiments (4.2.5).
Nothing on this way knows where the cameras or the arm stand: what it needs of that is in the taught samples.

IJS is a short cut. The long way of the thesis (3.1) is not here yet: CSS, from I' to a point C in the camera's frame;
CAS, from C and the head's pan and tilt to a point A in the arm's frame; AJS, from A and the joints to Δθ; and
beside it SCS, from I to the turn of the head that centres the object. Until then the head must stand as it stood while
teaching.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from handeye.modules.answers import Answer
from handeye.modules.ijs import input_vector
from handeye.modules.module import Module
from handeye.modules.spaces import ImagePair, ImageVector, JointAngles, JointDifference

Image = NDArray[np.uint8]


class Sees(Protocol):
    """RSS: what finds an object by its name, and the hand, in two images.

    `handeye.modules.recognition.Recogniser` does; it raises `NotSeen` when one of them is not to be found.
    """

    def see(self, left: Image, right: Image, name: str, /) -> ImagePair:
        """Where object and hand are."""
        ...


def recognise(recogniser: Sees, left: Image, right: Image, object_name: str) -> ImagePair:
    """RSS: two images -> I."""
    return recogniser.see(left, right, object_name)


def specify_action(found: ImagePair) -> ImageVector:
    """ASM: I -> I', the vector from hand to object (Fig 3.2)."""
    return ImageVector(
        rows=found.object.row - found.hand.row,
        columns=found.object.column - found.hand.column,
        disparity=found.object.disparity - found.hand.disparity,
    )


def image_to_joints(
    ijs: Module, subtask: int, action: ImageVector, joints: JointAngles
) -> tuple[JointDifference, Answer]:
    """IJS: the subtask's number, I' and the joints -> Δθ, and the answer it was taken from.

    Raises `NotTaught` when the subtask was never shown.
    """
    answer = ijs.answer(input_vector(subtask, action, joints))
    return JointDifference(answer.output), answer
