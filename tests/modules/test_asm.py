"""The way from hand to object is the same in the hand's own axes wherever the hand stands and however it is turned."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from handeye.modules import asm
from handeye.modules.module import Module
from handeye.modules.spaces import ImagePair, ImagePoint
from tests.modules.hands import FACING, WAY, look, metric_css, turned


@pytest.fixture(scope="module")
def stereo() -> Module:
    return metric_css()


@settings(deadline=None, max_examples=60)
@given(
    rotation=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    place=st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0.9, 1.1)),
)
def test_the_way_is_the_same_everywhere(
    stereo: Module, rotation: tuple[float, float, float], place: tuple[float, float, float]
) -> None:
    found = look(np.array(place), turned(rotation) @ FACING)
    assert asm.in_hand(stereo, found).array() == pytest.approx(WAY, abs=1e-3)


def test_in_the_picture_it_is_not(stereo: Module) -> None:
    ways = [
        asm.in_picture(look(np.array([0.0, 0.0, 1.0]), turned((0.0, 0.0, angle)) @ FACING)).array()
        for angle in (0.0, 0.3)
    ]
    assert np.abs(ways[1] - ways[0]).max() > 10.0


def test_a_hand_without_outline_has_no_axes(stereo: Module) -> None:
    point = ImagePoint(240.0, 320.0, 180.0)
    with pytest.raises(TypeError, match="outline"):
        asm.in_hand(stereo, ImagePair(point, point))
