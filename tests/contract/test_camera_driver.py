"""What every camera driver promises, whether fake, simulated or on the other side of the bus."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest

from handeye.rpc.errors import DeadlineExceeded
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


def test_pictures_have_the_size_that_is_said(eyes: Eyes) -> None:
    rows, columns = eyes.cameras.size
    pair = eyes.cameras.grab_stereo(0.0, TIMEOUT)
    observer = eyes.cameras.grab_observer(0.0, TIMEOUT)
    for frame in (pair.left, pair.right, observer):
        assert frame.image.shape == (rows, columns, 3)
        assert frame.image.dtype == np.uint8


def test_a_pair_says_when_it_was_taken(eyes: Eyes) -> None:
    eyes.advance(0.1)
    now = eyes.head.state().world_time
    pair = eyes.cameras.grab_stereo(0.0, TIMEOUT)
    assert pair.skew == pytest.approx(pair.right.world_time - pair.left.world_time, abs=1e-9)
    assert pair.right.world_time == pytest.approx(now - eyes.cameras.latency, abs=0.005)
    assert pair.right.world_time + eyes.cameras.latency <= now + 1e-9
    assert pair.head.world_time == pytest.approx(pair.left.world_time)


def test_a_pair_is_not_older_than_asked(eyes: Eyes) -> None:
    since = eyes.head.state().world_time
    eyes.advance(eyes.cameras.latency + 0.02)
    pair = eyes.cameras.grab_stereo(since, TIMEOUT)
    assert min(pair.left.world_time, pair.right.world_time) >= since - 1e-9


@pytest.mark.parametrize("observer", [False, True], ids=["stereo", "observer"])
def test_a_picture_of_the_future_ends_with_the_deadline(eyes: Eyes, observer: bool) -> None:
    now = eyes.head.state().world_time
    grab = eyes.cameras.grab_observer if observer else eyes.cameras.grab_stereo
    started = time.monotonic()
    with pytest.raises(DeadlineExceeded, match="newest"):
        grab(now + 1000.0, 0.5)
    assert 0.3 < time.monotonic() - started < 3.0


def test_what_the_tick_raises_ends_the_wait(eyes: Eyes) -> None:
    class Enough(Exception):
        pass

    ticks = 0

    def tick() -> None:
        nonlocal ticks
        ticks += 1
        if ticks == 5:
            raise Enough

    started = time.monotonic()
    with pytest.raises(Enough):
        eyes.cameras.grab_stereo(eyes.head.state().world_time + 1000.0, TIMEOUT, tick)
    assert time.monotonic() - started < 3.0


def test_new_pictures_are_counted_and_old_ones_are_not(eyes: Eyes) -> None:
    first = eyes.cameras.grab_stereo(0.0, TIMEOUT)
    again = eyes.cameras.grab_stereo(0.0, TIMEOUT)
    assert (again.left.sequence, again.right.sequence) == (first.left.sequence, first.right.sequence)
    assert np.array_equal(again.left.image, first.left.image)
    eyes.advance(0.05)
    later = eyes.cameras.grab_stereo(0.0, TIMEOUT)
    assert later.left.sequence == first.left.sequence + 1
    assert later.right.sequence == first.right.sequence + 1
    assert later.left.world_time > first.left.world_time
