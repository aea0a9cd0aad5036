"""The way from hand to object is the same in the hand's own axes wherever the hand stands and however it is turned."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from handeye.modules import asm, css
from handeye.modules.module import Module
from handeye.modules.spaces import HandPoint, ImagePair, ImagePoint

FOCAL, BASELINE = 600.0, 0.3
HALF = 0.035  # m
CORNERS = HALF * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0.0]])
WAY = np.array([0.02, -0.07, 0.11])  # right, up, out

Array = NDArray[np.float64]


def seen(points: Array) -> Array:
    """(n, 3) m in the camera's frame -> (n, 3) row, column, disparity."""
    x, y, z = points.T
    return np.column_stack([240 + FOCAL * y / z, 320 + FOCAL * x / z, FOCAL * BASELINE / z])


@pytest.fixture(scope="module")
def stereo() -> Module:
    module = Module(css.DECLARATION)
    steps = [np.linspace(-0.3, 0.3, 12), np.linspace(-0.3, 0.3, 12), np.linspace(0.7, 1.3, 12)]
    points = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 3)
    module.learn(seen(points), points, ["grid"] * len(points))
    return module


def turned(rotation: tuple[float, float, float]) -> Array:
    """Rotation matrix (3, 3) of a vector in rad."""
    angle = float(np.linalg.norm(rotation)) or 1.0
    x, y, z = np.array(rotation) / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix: Array = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return matrix


def look(place: Array, rotation: Array) -> ImagePair:
    """A hand at `place` whose axes are the columns of `rotation`, and an object `WAY` from it."""
    hand, *corners, thing = seen(place + np.array([np.zeros(3), *CORNERS, WAY]) @ rotation.T).tolist()
    return ImagePair(ImagePoint(*thing), HandPoint(hand[0], hand[1], hand[2], tuple(map(tuple, corners))))


FACING = np.diag([1.0, -1.0, -1.0])  # a marker that is read straight: its up is the camera's -y


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
