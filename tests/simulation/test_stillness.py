"""When an arm counts as standing still."""

from __future__ import annotations

import math

import numpy as np

from handeye.simulation.scene import STEP
from handeye.simulation.stillness import Stillness


def after(steps: int, place: float, speed: float, twitch: float) -> tuple[Stillness, int]:
    """An arm that was led, and then drifts at `speed` rad/s and twitches by `twitch` rad at every fifth step."""
    stillness = Stillness()
    stillness.begin()
    for step in range(20):
        stillness.observe(np.full(6, 0.01 * step), led=True)
    for step in range(steps):
        joints = np.full(6, place + speed * step * STEP + (twitch if step % 5 == 0 else 0.0))
        stillness.observe(joints, led=False)
    return stillness, 20 + steps


def test_an_arm_that_twitches_with_what_it_holds_stands_still() -> None:
    stillness, now = after(60, 0.19, speed=0.0, twitch=4e-5)  # 0.01 rad/s for a step, as was seen with a gripped cup
    assert not stillness.busy
    assert stillness.since(now) < (now - 40) * STEP


def test_an_arm_that_creeps_does_not() -> None:
    stillness, now = after(60, 0.19, speed=4e-3, twitch=0.0)
    assert stillness.busy
    assert math.isinf(stillness.since(now))


def test_what_twitches_for_ever_stands_still_after_a_while() -> None:
    """As some grips do, by 0.25 mrad: it would never be looked at."""
    stillness, _ = after(60, 0.19, speed=0.0, twitch=2.5e-4)
    assert stillness.busy
    stillness, now = after(200, 0.19, speed=0.0, twitch=2.5e-4)
    assert not stillness.busy
    assert stillness.since(now) < (now - 100) * STEP


def test_an_arm_that_goes_on_does_not() -> None:
    stillness, now = after(200, 0.19, speed=2e-2, twitch=0.0)
    assert stillness.busy
    assert math.isinf(stillness.since(now))


def test_an_arm_that_has_just_come_to_its_place_does_not_yet() -> None:
    stillness, now = after(3, 0.19, speed=0.0, twitch=0.0)
    assert math.isinf(stillness.since(now))
