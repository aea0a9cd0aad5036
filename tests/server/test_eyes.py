"""The coordinator's eyes with the real recognition behind them."""

from __future__ import annotations

import threading
from contextlib import closing

import cv2
import numpy as np
import pytest

from handeye.camera_bridge.driver import Image
from handeye.modules.recognition import NotSeen
from handeye.modules.spaces import HeadAngles, ImagePair, ImagePoint
from handeye.server.eyes import Vision
from handeye.server.pictures import jpeg, right_column, side_by_side
from handeye.server.problem import Invalid, NotFound

HEAD = HeadAngles(0.0, -0.5)
EMPTY: Image = np.full((240, 320, 3), 120, np.uint8)


def with_cup(column: int) -> Image:
    image = EMPTY.copy()
    cv2.rectangle(image, (column, 80), (column + 40, 150), (200, 40, 30), cv2.FILLED)
    return image


def test_an_object_is_learned_from_pictures_and_missed_where_it_is_not() -> None:
    vision = Vision()
    vision.learn("cup", [EMPTY, EMPTY], [with_cup(150), with_cup(110)])
    with pytest.raises(NotSeen):  # the hand's marker is not there
        vision.see(with_cup(150), with_cup(110), "cup", HEAD)


def test_an_object_that_was_deleted_meanwhile_is_not_known_any_more() -> None:
    vision = Vision()
    vision.learn("cup", [EMPTY, EMPTY], [with_cup(150), with_cup(110)])
    vision.forget("cup")
    for see in (vision.see, vision.see_object):
        with pytest.raises(NotFound, match="'cup' is not known any more"):
            see(with_cup(150), with_cup(110), "cup", HEAD)


def test_pictures_that_show_nothing_new_teach_nothing() -> None:
    with pytest.raises(Invalid, match=r"Object 'cup' cannot be learned: .*background"):
        Vision().learn("cup", [EMPTY], [EMPTY])


def test_found_points_are_marked_in_both_pictures() -> None:
    found = ImagePair(object=ImagePoint(60.0, 100.0, 20.0), hand=ImagePoint(180.0, 250.0, 30.0))
    assert right_column(found.object) == 80.0
    marked = cv2.imdecode(np.frombuffer(side_by_side(EMPTY, EMPTY, found), np.uint8), cv2.IMREAD_COLOR)
    assert marked is not None
    assert marked.shape == (240, 640, 3)
    blue, green, red = (int(value) for value in marked[60, 100])
    assert red > green + 60
    blue, green, red = (int(value) for value in marked[180, 320 + 220])
    assert green > max(red, blue) + 60
    bare = cv2.imdecode(np.frombuffer(side_by_side(EMPTY, EMPTY, NotSeen("x")), np.uint8), cv2.IMREAD_COLOR)
    assert bare is not None
    assert np.ptp(bare) < 3


def test_colours_survive_the_encoding() -> None:
    image = cv2.imdecode(np.frombuffer(jpeg(with_cup(100)), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    np.testing.assert_allclose(image[115, 120], (30, 40, 200), atol=12)  # blue green red


def test_guides_are_made_anew_beside_the_looks_and_end_with_the_vision() -> None:
    with closing(Vision()) as vision:
        vision.learn("cup", [EMPTY, EMPTY], [with_cup(150), with_cup(110)])
        assert vision.guesses(with_cup(150), with_cup(110), "cup", HEAD) is None
        for column in range(100, 148, 2):
            vision.see_object(with_cup(column + 40), with_cup(column), "cup", HEAD)
        vision.settle()
        said = vision.guesses(with_cup(155), with_cup(115), "cup", HEAD)
        assert said is not None
        assert said.trusted
        assert abs(said.left.column - 175) < 20
    for column in range(24):  # closed: nothing is made anew
        vision.see_object(with_cup(column + 140), with_cup(column + 100), "cup", HEAD)
    assert "guides" not in {thread.name for thread in threading.enumerate()}
