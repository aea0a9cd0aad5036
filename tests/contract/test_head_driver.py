"""What every head driver promises, whether fake, simulated or on the other side of the bus."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from handeye.rpc.errors import OutOfLimits
from tests.contract.camera_fixtures import EYES, Eyes, ending_what_it_starts

TIMEOUT = 20.0


@pytest.fixture(autouse=True, scope="module")
def nothing_left_running() -> Iterator[None]:
    with ending_what_it_starts():
        yield


@pytest.fixture(params=list(EYES), scope="module")
def eyes(request: pytest.FixtureRequest) -> Iterator[Eyes]:
    with EYES[request.param]() as made:
        yield made


def test_a_move_returns_what_was_reached(eyes: Eyes) -> None:
    before = eyes.head.state()
    reached = eyes.head.move(0.11, -0.31, eyes.lease_id, TIMEOUT, eyes.beat)
    assert not reached.moving
    assert (reached.pan, reached.tilt) == pytest.approx((0.11, -0.31), abs=eyes.head.step / 2 + 1e-9)
    assert eyes.head.state() == reached
    # It took its time.
    assert reached.world_time - before.world_time > 0.11 / eyes.head.speed


def test_a_move_to_where_it_points_changes_nothing(eyes: Eyes) -> None:
    before = eyes.head.state()
    after = eyes.head.move(before.pan, before.tilt, eyes.lease_id, TIMEOUT, eyes.beat)
    assert (after.pan, after.tilt, after.moving) == (before.pan, before.tilt, False)


@pytest.mark.parametrize("axis", ["pan", "tilt"])
@pytest.mark.parametrize("side", [0, 1], ids=["below", "above"])
def test_it_refuses_what_is_out_of_range(eyes: Eyes, axis: str, side: int) -> None:
    pan_range, tilt_range = eyes.head.limits
    assert pan_range[0] < pan_range[1]
    assert tilt_range[0] < tilt_range[1]
    beyond = (-0.01, 0.01)[side]
    before = eyes.head.state()
    pan, tilt = (pan_range[side] + beyond, 0.0) if axis == "pan" else (0.0, tilt_range[side] + beyond)
    with pytest.raises(OutOfLimits, match=axis):
        eyes.head.move(pan, tilt, eyes.lease_id, TIMEOUT, eyes.beat)
    assert eyes.head.state() == before


def test_a_picture_says_where_the_head_pointed(eyes: Eyes) -> None:
    reached = eyes.head.move(-0.07, -0.4, eyes.lease_id, TIMEOUT, eyes.beat)
    eyes.advance(0.1)
    pair = eyes.cameras.grab_stereo(reached.world_time, TIMEOUT)
    assert (pair.head.pan, pair.head.tilt, pair.head.moving) == (reached.pan, reached.tilt, False)
