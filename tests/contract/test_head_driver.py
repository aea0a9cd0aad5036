"""What every head driver promises, whether fake, simulated or on the other side of the bus."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from handeye.camera_bridge.driver import LONGEST_FOLLOW, Course
from handeye.rpc.errors import InvalidArgument, OutOfLimits
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


def test_it_follows_what_moves_without_being_waited_for(eyes: Eyes) -> None:
    start = eyes.head.move(-0.2, -0.35, eyes.lease_id, TIMEOUT, eyes.beat)
    course = Course(-0.18, -0.35, 0.2, -0.05, start.world_time)
    begun = eyes.head.follow(course, 2.0, eyes.lease_id, TIMEOUT)
    assert begun.world_time - start.world_time < 0.1  # in lockstep: none
    eyes.advance(0.8)
    there = eyes.head.state()
    assert there.moving
    assert (there.pan, there.tilt) == pytest.approx(course.at(there.world_time), abs=eyes.head.step + 1e-3)
    turned = eyes.head.follow(Course(there.pan, there.tilt, -0.2, 0.0, there.world_time), 0.6, eyes.lease_id, TIMEOUT)
    assert turned.moving
    eyes.advance(2.0)
    at_last = eyes.head.state()
    assert not at_last.moving
    assert at_last.pan == pytest.approx(there.pan - 0.2 * 0.6, abs=0.03)
    eyes.advance(0.2)
    assert (eyes.head.state().pan, eyes.head.state().tilt) == (at_last.pan, at_last.tilt)


def test_it_stands_still_at_once_when_told_to_follow_for_no_time(eyes: Eyes) -> None:
    start = eyes.head.move(0.0, -0.3, eyes.lease_id, TIMEOUT, eyes.beat)
    eyes.head.follow(Course(0.0, -0.3, 0.3, 0.0, start.world_time), 2.0, eyes.lease_id, TIMEOUT)
    eyes.advance(0.5)
    moving = eyes.head.state()
    eyes.head.follow(Course(moving.pan, moving.tilt, 0.0, 0.0, moving.world_time), 0.0, eyes.lease_id, TIMEOUT)
    eyes.advance(0.5)
    still = eyes.head.state()
    assert not still.moving
    assert moving.pan <= still.pan < moving.pan + 0.05


@pytest.mark.parametrize(
    ("course", "lasting", "error"),
    [
        (Course(4.0, 0.0, 0.0, 0.0, 0.0), 1.0, OutOfLimits),
        (Course(0.0, math.nan, 0.0, 0.0, 0.0), 1.0, InvalidArgument),
        (Course(0.0, 0.0, math.inf, 0.0, 0.0), 1.0, InvalidArgument),
        (Course(0.0, 0.0, 0.0, 0.0, 0.0), LONGEST_FOLLOW + 0.1, InvalidArgument),
        (Course(0.0, 0.0, 0.0, 0.0, 0.0), -0.1, InvalidArgument),
        (Course(0.0, 0.0, 0.0, 0.0, 0.0), math.nan, InvalidArgument),
    ],
)
def test_it_refuses_a_course_that_it_cannot_follow(
    eyes: Eyes, course: Course, lasting: float, error: type[Exception]
) -> None:
    before = eyes.head.state()
    with pytest.raises(error):
        eyes.head.follow(course, lasting, eyes.lease_id, TIMEOUT)
    assert eyes.head.state() == before
