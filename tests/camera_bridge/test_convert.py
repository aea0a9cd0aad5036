"""Driver types survive the way over the bus; a broken message is refused."""

from __future__ import annotations

import numpy as np
import pytest

from handeye.camera_bridge import convert
from handeye.camera_bridge.driver import CameraDescription, Frame, HeadState, StereoPair
from handeye.rpc.errors import Internal


def _frame(sequence: int) -> Frame:
    pixels = np.random.default_rng(sequence).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    return Frame(pixels, 1.25 + sequence, sequence)


def test_a_stereo_pair_survives() -> None:
    pair = StereoPair(_frame(3), _frame(4), 0.004, HeadState(0.1, -0.2, True, 4.25))
    back = convert.stereo_from_message(convert.stereo_to_message(pair))
    for sent, received in ((pair.left, back.left), (pair.right, back.right)):
        assert np.array_equal(sent.image, received.image)
        assert received.image.dtype == np.uint8
        assert (sent.world_time, sent.sequence) == (received.world_time, received.sequence)
    assert (back.skew, back.head) == (pair.skew, pair.head)


def test_a_description_survives() -> None:
    description = CameraDescription(640, 480, (-3.0, 3.0), (-1.0, 0.5), 0.001, 2.0, 0.05)
    assert convert.description_from_message(convert.description_to_message(description)) == description


@pytest.mark.parametrize("fault", ["size", "encoding"])
def test_a_picture_that_does_not_fit_its_size_is_refused(fault: str) -> None:
    message = convert.frame_to_message(_frame(0))
    if fault == "size":
        message.width += 1
    else:
        message.encoding = "bgr8"
    with pytest.raises(Internal, match="bytes"):
        convert.frame_from_message(message)
