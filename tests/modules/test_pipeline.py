from __future__ import annotations

import numpy as np
import pytest

from handeye.modules import ijs
from handeye.modules.module import Module
from handeye.modules.pipeline import Image, Sees, image_to_joints, recognise, specify_action
from handeye.modules.spaces import HeadAngles, ImagePair, ImagePoint, ImageVector, JointAngles

LEFT = np.zeros((2, 2, 3), np.uint8)
RIGHT = np.ones((2, 2, 3), np.uint8)
PAIR = ImagePair(object=ImagePoint(200, 320, 150), hand=ImagePoint(180, 350, 160))
JOINTS = JointAngles(np.linspace(-1, 1, 6))


class Eye:
    """Sees PAIR whatever it is shown, and remembers what that was."""

    def __init__(self) -> None:
        self.shown: list[tuple[Image, Image, str, HeadAngles]] = []

    def see(self, left: Image, right: Image, name: str, head: HeadAngles, /) -> ImagePair:
        self.shown.append((left, right, name, head))
        return PAIR


def module() -> Module:
    """Two subtasks with one sample each, whose outputs are the subtask's number + 1."""
    taught = Module(ijs.DECLARATION)
    inputs = [ijs.input_vector(subtask, ImageVector(0, 0, 0), JOINTS) for subtask in (0, 1)]
    taught.train(inputs, [[1.0] * 6, [2.0] * 6], ["a", "b"])
    return taught


def test_recognise_shows_both_pictures_in_order() -> None:
    eye, head = Eye(), HeadAngles(0.1, -0.5)
    assert recognise(eye, LEFT, RIGHT, "blue cup", head) is PAIR
    assert eye.shown == [(LEFT, RIGHT, "blue cup", head)]


def test_the_action_points_from_hand_to_object() -> None:
    assert specify_action(PAIR) == ImageVector(rows=20, columns=-30, disparity=-10)


@pytest.mark.parametrize("subtask", [0, 1])
def test_image_to_joints_answers_for_the_subtask(subtask: int) -> None:
    turn, answer = image_to_joints(module(), subtask, ImageVector(1, 2, 3), JOINTS)
    assert turn.array().tolist() == [subtask + 1.0] * 6
    assert answer.neighbours[0].demonstration == "ab"[subtask]


def test_the_recogniser_fits() -> None:
    from handeye.modules.guided import GuidedRecogniser
    from handeye.modules.recognition import Recogniser

    eye: Sees = GuidedRecogniser(Recogniser())
    assert callable(eye.see)
