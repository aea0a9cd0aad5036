from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from handeye.modules import spaces
from handeye.modules.spaces import ImagePair, ImagePoint, ImageVector, JointAngles, JointDifference


@pytest.mark.parametrize(
    ("space", "components"),
    [
        (ImagePoint(1, 2, 3), [1, 2, 3]),
        (ImageVector(1, 2, 3), [1, 2, 3]),
        (JointAngles(np.arange(6.0)), [0, 1, 2, 3, 4, 5]),
        (JointDifference(np.arange(6.0)), [0, 1, 2, 3, 4, 5]),
    ],
)
def test_components_come_in_the_order_of_the_fields(
    space: ImagePoint | ImageVector | JointAngles | JointDifference, components: list[int]
) -> None:
    assert space.array().dtype == np.float64
    assert space.array().tolist() == components


def test_spaces_are_frozen() -> None:
    point = ImagePoint(1, 2, 3)
    with pytest.raises(dataclasses.FrozenInstanceError):
        point.row = 5  # type: ignore[misc]


def test_recognition_is_sure_unless_it_says_otherwise() -> None:
    pair = ImagePair(ImagePoint(1, 2, 3), ImagePoint(4, 5, 6))
    assert pair.object_confidence == pair.hand_confidence == 1.0


def test_every_space_tells_dimension_unit_and_frame() -> None:
    for name in ("ImagePoint", "ImagePair", "ImageVector", "JointAngles", "JointDifference"):
        text = getattr(spaces, name).__doc__
        assert "px" in text or "rad" in text
        assert "frame:" in text or "in the stereo image" in text
        assert "dimension" in text or "one angle for each joint" in text
