"""The filter behind a pursuit: from late, uneven and noisy looks to where something is and how it moves."""

from __future__ import annotations

import numpy as np
import pytest

from handeye.modules.spaces import HeadAngles
from handeye.server.pursuit import PursuitSettings
from handeye.server.tracking import Tracker

SETTINGS = PursuitSettings()


def tracker() -> Tracker:
    return Tracker(SETTINGS.noise, SETTINGS.agility)


def test_what_was_never_seen_has_no_course() -> None:
    with pytest.raises(ValueError, match="nothing has been seen"):
        _ = tracker().course


def test_what_was_seen_once_is_held_to_stand_still() -> None:
    seen = tracker()
    seen.see(HeadAngles(0.3, -0.5), 7.0)
    assert seen.course.at(9.0) == (0.3, -0.5)


def test_two_looks_tell_how_it_moves() -> None:
    seen = tracker()
    for time in (2.0, 2.7):
        seen.see(HeadAngles(0.1 * time, -0.5), time)
    assert seen.course.at(3.4) == pytest.approx((0.34, -0.5), abs=5e-3)
    assert (seen.course.pan_rate, seen.course.tilt_rate) == pytest.approx((0.1, 0.0), abs=0.01)


@pytest.mark.parametrize(("every", "most"), [(0.05, 1.5), (0.1, 5**0.5), (0.7, 3.5)])
def test_noise_is_evened_out_among_looks_that_follow_each_other_closely(every: float, most: float) -> None:
    random = np.random.default_rng(5)
    seen, time, missed = tracker(), 0.0, []
    for number in range(400):
        time += every * random.uniform(0.6, 1.4)
        if number > 20:
            missed.append(np.subtract(seen.course.at(time), (0.05 * time, -0.02 * time)))
        noise = random.normal(0.0, SETTINGS.noise, 2)
        seen.see(HeadAngles(0.05 * time + noise[0], -0.02 * time + noise[1]), time)
    # Who takes the last two looks at their word misses the next by √5 times the noise, and by more at uneven times.
    assert np.std(missed) < most * SETTINGS.noise
    assert np.abs(np.mean(missed)) < 0.3 * SETTINGS.noise


def test_it_notices_when_something_turns_round() -> None:
    seen = tracker()
    for time in np.arange(0.0, 6.0, 0.5):
        seen.see(HeadAngles(0.1 * min(time, 6.0 - time), 0.0), time)
    assert seen.course.pan_rate == pytest.approx(-0.1, abs=0.01)
