"""The head's motion: trapezoids in whole steps, as a function of time."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from handeye.camera_bridge.driver import Course
from handeye.camera_bridge.turning import Track, Turn, check_limits, to_step
from handeye.rpc.errors import OutOfLimits

SPEED, ACCELERATION = 1.5, 3.0
STEP = math.radians(0.0514)
ANGLE = st.floats(-3.0, 3.0)


@settings(max_examples=40)
@given(a=ANGLE, b=ANGLE, c=ANGLE, d=ANGLE)
def test_a_turn_keeps_to_speed_and_acceleration(a: float, b: float, c: float, d: float) -> None:
    turn = Turn(2.0, (a, b), (c, d), SPEED, ACCELERATION)
    assert turn.at(0.0) == (a, b)
    assert turn.at(turn.end) == pytest.approx((c, d), abs=1e-9)
    assert turn.at(turn.end + 5.0) == (c, d)
    interval = max((turn.end - turn.start) / 60, 1e-3)
    for axis in range(2):
        angles = [turn.at(turn.start + i * interval)[axis] for i in range(65)]
        speeds = [(after - before) / interval for before, after in pairwise(angles)]
        changes = [(after - before) / interval for before, after in pairwise(speeds)]
        assert max(map(abs, speeds)) <= SPEED + 1e-6
        assert max(map(abs, changes)) <= ACCELERATION + 1e-6
        assert min(a, c) - 1e-9 <= turn.at(turn.start + 0.1)[0] <= max(a, c) + 1e-9


def test_a_long_turn_runs_at_full_speed() -> None:
    turn = Turn(0.0, (0.0, 0.0), (3.0, 0.0), SPEED, ACCELERATION)
    assert turn.end == pytest.approx(3.0 / SPEED + SPEED / ACCELERATION)
    assert turn.at(1.1)[0] - turn.at(1.0)[0] == pytest.approx(0.1 * SPEED)


@given(pan=ANGLE, tilt=ANGLE, at=st.floats(0.0, 5.0))
def test_a_head_points_in_whole_steps(pan: float, tilt: float, at: float) -> None:
    track = Track((0.0, -0.5), STEP, SPEED, ACCELERATION)
    track.turn(0.0, (pan, tilt))
    for angle in track.at(at)[0]:
        assert angle / STEP == pytest.approx(round(angle / STEP), abs=1e-6)
    reached, moving = track.at(100.0)
    assert not moving
    assert reached == pytest.approx((pan, tilt), abs=STEP / 2 + 1e-12)


def test_without_steps_it_reaches_exactly_what_was_asked() -> None:
    assert to_step(0.123456789, 0.0) == 0.123456789


def test_a_track_remembers_where_the_head_pointed() -> None:
    track = Track((0.0, 0.0), 0.0, SPEED, ACCELERATION)
    assert not track.turned
    first = track.turn(1.0, (0.5, 0.0))
    second = track.turn(10.0, (0.5, 0.25))
    assert track.at(0.5) == ((0.0, 0.0), False)
    assert track.at(1.1)[1]
    assert track.at(first.end) == ((0.5, 0.0), False)
    assert track.at(9.0) == ((0.5, 0.0), False)
    assert track.at(second.end) == ((0.5, 0.25), False)
    track.clear()
    assert track.at(20.0) == ((0.0, 0.0), False)


@settings(max_examples=30, deadline=None)
@given(pan=st.floats(-1.0, 1.0), rate=st.floats(-0.6, 0.6), again=st.floats(-0.6, 0.6), when=st.floats(0.02, 1.4))
def test_a_chase_keeps_to_speed_and_acceleration_and_catches_up(
    pan: float, rate: float, again: float, when: float
) -> None:
    track = Track((0.0, 0.0), 0.0, SPEED, ACCELERATION)
    ranges = ((-3.0, 3.0), (-1.0, 1.0))
    track.follow(10.0, Course(pan, 0.0, rate, 0.0, 10.0), 2.5, ranges)
    second = Course(pan, 0.1, again, 0.1, 10.0 + when)
    track.follow(10.0 + when, second, 2.5, ranges)
    tick = 1.0 / 240.0
    for axis in range(2):
        angles = [track.at(10.0 + i * tick)[0][axis] for i in range(1400)]
        speeds = [(after - before) / tick for before, after in pairwise(angles)]
        changes = [(after - before) / tick for before, after in pairwise(speeds)]
        assert max(map(abs, speeds)) <= SPEED + 1e-6
        # A change between two ticks shows in two of them.
        assert max(map(abs, changes)) <= 2 * ACCELERATION + 1e-6
    caught = 10.0 + when + 2.4
    assert track.at(caught)[0] == pytest.approx(second.at(caught), abs=2e-3)
    assert track.at(caught)[1]
    assert not track.at(20.0)[1]


def test_a_chase_ends_at_the_end_of_the_range() -> None:
    track = Track((0.0, 0.0), 0.0, SPEED, ACCELERATION)
    track.follow(0.0, Course(0.0, 0.0, 1.0, 0.0, 0.0), 3.0, ((-0.5, 0.5), (-1.0, 1.0)))
    assert max(track.at(i / 240)[0][0] for i in range(1000)) <= 0.5
    assert track.at(10.0)[0][0] > 0.4


def test_a_halted_head_stays_where_it_is() -> None:
    track = Track((0.0, 0.0), 0.0, SPEED, ACCELERATION)
    track.turn(0.0, (2.0, 0.0))
    there = track.at(0.7)[0]
    track.halt(0.7)
    assert track.at(0.7) == (there, False)
    assert track.at(9.0) == (there, False)
    assert track.at(0.3)[1]


@pytest.mark.parametrize(("pan", "tilt", "named"), [(1.1, 0.0, "pan"), (0.0, -0.3, "tilt"), (math.nan, 0.0, "pan")])
def test_out_of_range_is_refused_by_name(pan: float, tilt: float, named: str) -> None:
    with pytest.raises(OutOfLimits, match=named) as refused:
        check_limits(pan, tilt, (-1.0, 1.0), (-0.2, 0.2))
    assert refused.value.detail == named
