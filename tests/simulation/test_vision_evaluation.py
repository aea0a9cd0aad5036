"""The evaluation of recognition: how pictures are disturbed and judged, and what figures are made of the trials."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from handeye.modules.recognition import NotSeen, Recogniser
from handeye.modules.spaces import HandPoint, ImagePair, ImagePoint
from handeye.modules.window import Image
from handeye.simulation.evaluation import EVALUATIONS
from handeye.simulation.evaluation.disturbing import DISTURBANCES, Disturbance, disturbed, shown

OBJECT, HAND = ImagePoint(240.0, 300.0, 90.0), HandPoint(120.0, 330.0, 100.0, ())


class Pretender(Recogniser):
    """Finds the object where a red point is, and the hand where it is."""

    def see(self, left: Image, right: Image, name: str) -> ImagePair:
        return ImagePair(self.see_object(left, right, name)[0], HAND)

    def see_object(self, left: Image, _right: Image, _name: str, _windows: object = None) -> tuple[ImagePoint, float]:
        red = np.argwhere((left[..., 0] > 240) & (left[..., 2] < 50))
        if not len(red):
            raise NotSeen("there is no red point")
        row, column = np.median(red, axis=0)
        return ImagePoint(float(row), float(column), OBJECT.disparity), 1.0

    def see_hand(self, _left: Image, _right: Image, _windows: object = None) -> tuple[HandPoint, float]:
        return HAND, 1.0


def pair() -> tuple[Image, Image]:
    images = []
    for column in (300, 210):
        image = np.full((480, 640, 3), 120, np.uint8)
        image[239:242, column - 1 : column + 2] = (250, 20, 20)
        images.append(image)
    return images[0], images[1]


@pytest.mark.parametrize("disturbance", DISTURBANCES, ids=lambda disturbance: disturbance.name)
def test_a_disturbance_begins_with_none_and_leaves_the_picture_it_was_given(disturbance: Disturbance) -> None:
    random, left = np.random.default_rng(0), pair()[0]
    before, places = left.copy(), ((240.0, 300.0), (120.0, 330.0))
    none = 1.0 if disturbance.name == "light" else 0.0
    assert none in disturbance.levels
    np.testing.assert_array_equal(disturbance.apply(left, places, none, random), before)
    worst = disturbance.apply(left, places, disturbance.levels[-1], random)
    assert worst.shape == before.shape
    assert (worst != before).any()
    np.testing.assert_array_equal(left, before)
    if disturbance.name == "clutter":  # the object stays in view
        np.testing.assert_array_equal(worst[210:270, 280:320], before[210:270, 280:320])


def test_finds_are_right_missed_or_wrong() -> None:
    told = disturbed(Pretender(), "cup", [pair()], np.random.default_rng(0))
    assert len(told) == sum(len(kind.levels) for kind in DISTURBANCES)
    light = {each["level"]: each["object"] for each in told if each["kind"] == "light"}
    assert light[1.0] == "right"
    assert light[0.4] == "missed"
    assert {each["hand"] for each in told} == {"right"}
    assert all(each["object_off_px"] <= 3.0 for each in told if each["object"] == "right")
    assert len(shown(Pretender(), "cup", pair(), np.random.default_rng(0))) == len(DISTURBANCES)


def look(thing: str, off: float, *, flagged: bool = False, scene: str = "arm near") -> dict[str, Any]:
    times = {
        "search_whole_ms": 5.0,
        "search_window_ms": 1.0,
        "whole_ms": 8.0,
        "window_ms": 2.0,
        "guides_ms": 1.0,
        "guided_ms": 4.0,
    }
    seen = {"scene": scene, "thing": thing, "flagged": flagged, "found": True, "off_px": [off, 1.0]}
    return {"what": "look", **seen, "truth_px": [0.1, 0.2, 0.3], **times}


def test_figures_count_blunders_only_where_they_were_not_flagged() -> None:
    rest: list[dict[str, Any]] = [
        {"what": "grasp", "passed": {"approach": True, "grasp": True, "lift": True}, "failure": ""},
        {"what": "absent", "flagged": True, "found": False},
        {"what": "new cup", "found": True, "truth_px": [0.0, 0.0, 0.0]},
        {"what": "disturbed", "kind": "noise", "level": 0.0, "object": "right", "hand": "right"},
    ]
    looks = [look("object", 5.0), look("hand", 6.0), look("hand", 90.0, flagged=True), look("object", 4.0)]
    looks += [look("hand", 200.0, scene="head turned", flagged=True)]
    evaluation = EVALUATIONS["vision"]
    figures = {each.name: each for each in evaluation.figures([*rest, *looks])}
    assert figures["no guess more than 50 px off unflagged"].met
    assert figures["ordinary looks not flagged"].value == 75.0
    assert figures["detection alone, whole picture / window, object"].value == 5.0
    assert figures["with alignment, whole picture / window, object"].value == 4.0
    assert figures["whole picture / guided with the guides' own time, hand"].value == 2.0
    worse = evaluation.figures([*rest, *looks, look("object", 51.0)])
    assert not next(each for each in worse if each.name.startswith("no guess")).met
    assert sum(len(values) for values in evaluation.histograms([*rest, *looks]).values()) == 8
