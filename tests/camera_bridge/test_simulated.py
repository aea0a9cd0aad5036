"""The simulated cameras and head on a lab in lockstep and in realtime."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from handeye.camera_bridge.driver import Course
from handeye.rpc.errors import Busy, Cancelled, DeadlineExceeded, OutOfLimits, Stopped, Unauthorised
from handeye.simulation import objects, rig
from handeye.simulation.profile import Profile
from handeye.simulation.scene import STEP
from tests.contract.camera_fixtures import Eyes, Lab, ending_what_it_starts, eyes_of, lab

TIMEOUT = 20.0
HOME_PAN, HOME_TILT = rig.rig().head.home
PROFILE = Profile.named("default")


@dataclass(frozen=True)
class There:
    lab: Lab
    eyes: Eyes

    def grab_at_rest(self) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
        since = self.lab.robot.state().still_since
        self.eyes.advance(0.1)
        return self.eyes.cameras.grab_stereo(since, TIMEOUT).left.image


@pytest.fixture(autouse=True, scope="module")
def nothing_left_running() -> Iterator[None]:
    with ending_what_it_starts():
        yield


@pytest.fixture(scope="module")
def one_lab() -> Iterator[There]:
    with lab() as made, eyes_of(made) as eyes:
        yield There(made, eyes)


@pytest.fixture
def there(one_lab: There) -> There:
    one_lab.lab.world.reset(seed=3)
    return one_lab


def test_a_pair_is_late_by_latency_and_skew_of_the_profile(there: There) -> None:
    there.eyes.advance(0.5)
    pair = there.eyes.cameras.grab_stereo(0.0, TIMEOUT)
    assert pair.right.world_time == pytest.approx(0.5 - 0.05)
    assert pair.skew == pytest.approx(PROFILE.skew, abs=STEP / 2)
    assert pair.skew == pair.right.world_time - pair.left.world_time


def test_after_a_reset_the_world_is_shown_as_it_stands(there: There) -> None:
    pair = there.eyes.cameras.grab_stereo(0.0, TIMEOUT)
    assert (pair.left.world_time, pair.right.world_time, pair.skew) == (0.0, 0.0, 0.0)


def test_a_grab_in_lockstep_waits_for_the_lease_holder(there: There) -> None:
    later = threading.Timer(0.1, there.eyes.advance, (0.3,))
    later.start()
    pair = there.eyes.cameras.grab_stereo(0.2, TIMEOUT)
    later.join()
    assert pair.left.world_time >= 0.2


def test_the_message_of_a_deadline_names_the_newest_time(there: There) -> None:
    there.eyes.advance(0.5)
    with pytest.raises(DeadlineExceeded, match=r"it is 0\.500 s now.*shows 0\.446 s"):
        there.eyes.cameras.grab_stereo(7.0, 0.05)


def test_pictures_repeat_themselves_however_many_were_grabbed(there: There) -> None:
    def run(more: int) -> list[bytes]:
        there.lab.world.reset(seed=3)
        there.lab.world.place(objects.CUPS["blue cup"], [0.6, 0.05])
        for _ in range(more):
            there.eyes.advance(0.05)
            there.eyes.cameras.grab_stereo(0.0, TIMEOUT)
        there.eyes.advance(0.2 - 0.05 * more)
        pair = there.eyes.cameras.grab_stereo(0.0, TIMEOUT)
        return [pair.left.image.tobytes(), pair.right.image.tobytes()]

    assert run(0) == run(2)


def test_a_cup_shows_where_projection_says(there: There) -> None:
    empty = there.grab_at_rest().astype(int)
    there.lab.world.place(objects.CUPS["blue cup"], [0.6, 0.05])
    changed = np.abs(there.grab_at_rest().astype(int) - empty).max(axis=2) > 60
    centre = rig.project([0.6, 0.05, 0.0475], "left", HOME_PAN, HOME_TILT, PROFILE)
    assert np.argwhere(changed).mean(axis=0) == pytest.approx(centre, abs=4.0)


def test_the_head_turns_with_world_time_at_its_speed(there: There) -> None:
    unit = rig.rig().head
    pan = math.radians(70)
    reached = there.eyes.head.move(pan, HOME_TILT, there.eyes.lease_id, TIMEOUT, there.eyes.beat)
    expected = pan / unit.speed + unit.speed / unit.acceleration
    assert reached.world_time == pytest.approx(expected, abs=2 * STEP)
    assert reached.pan == pytest.approx(pan, abs=PROFILE.head_step / 2)
    assert reached.pan / PROFILE.head_step == pytest.approx(round(reached.pan / PROFILE.head_step), abs=1e-6)


def test_the_picture_turns_with_the_head(there: There) -> None:
    there.lab.world.place(objects.CUPS["red tumbler"], [0.6, 0.0])
    there.eyes.head.move(0.1, HOME_TILT, there.eyes.lease_id, TIMEOUT, there.eyes.beat)
    image = there.grab_at_rest().astype(int)
    red = (image[..., 0] - image[..., 1:].max(axis=2)) > 60
    head = there.eyes.head.state()
    centre = rig.project([0.6, 0.0, 0.0525], "left", head.pan, head.tilt, PROFILE)
    straight = rig.project([0.6, 0.0, 0.0525], "left", HOME_PAN, HOME_TILT, PROFILE)
    assert np.argwhere(red).mean(axis=0) == pytest.approx(centre, abs=8.0)  # a tumbler is wider at its top
    assert centre[1] - straight[1] > 50


def test_a_reset_sends_the_head_home(there: There) -> None:
    home = there.eyes.head.state()
    assert (home.pan, home.tilt) == pytest.approx((HOME_PAN, HOME_TILT), abs=PROFILE.head_step)
    there.eyes.head.move(0.2, -0.4, there.eyes.lease_id, TIMEOUT, there.eyes.beat)
    there.lab.world.place(objects.CUPS["blue cup"], [0.6, 0.05])
    there.lab.world.remove("blue cup")
    assert there.eyes.head.state().pan != 0.0  # placements are no resets
    there.lab.world.reset(seed=3)
    there.eyes.advance(2.0)  # even when nobody looked until world time is later than before
    after = there.eyes.head.state()
    assert (after.pan, after.tilt, after.moving) == (home.pan, home.tilt, False)


def test_the_head_needs_the_lease_in_lockstep(there: There) -> None:
    before = there.eyes.head.state()
    with pytest.raises(Unauthorised):
        there.eyes.head.move(0.2, -0.4, "no lease", TIMEOUT)
    there.eyes.advance(1.0)
    after = there.eyes.head.state()
    assert (after.pan, after.tilt, after.moving) == (before.pan, before.tilt, False)


@pytest.fixture
def realtime() -> Iterator[There]:
    with lab(clock="realtime") as made, eyes_of(made) as eyes:
        yield There(made, eyes)


def test_in_realtime_the_head_turns_by_itself_and_for_one_caller(realtime: There) -> None:
    head, lease_id, beat = realtime.eyes.head, realtime.eyes.lease_id, realtime.eyes.beat
    errors: list[Exception] = []

    def turn() -> None:
        try:
            head.move(0.6, HOME_TILT, lease_id, TIMEOUT, beat)
        except Exception as error:
            errors.append(error)

    mover = threading.Thread(target=turn)
    mover.start()
    while not head.state().moving and mover.is_alive():
        pass
    with pytest.raises(Busy, match="turning"):
        head.move(0.0, HOME_TILT, lease_id, TIMEOUT, beat)
    mover.join()
    assert not errors
    reached = head.state()
    assert reached.pan == pytest.approx(0.6, abs=PROFILE.head_step)
    pair = realtime.eyes.cameras.grab_stereo(reached.world_time, TIMEOUT)
    assert pair.head.pan == reached.pan


def test_in_realtime_the_head_needs_the_lease_and_a_robot_that_is_not_stopped(realtime: There) -> None:
    home = realtime.eyes.head.state()
    with pytest.raises(Unauthorised):
        realtime.eyes.head.move(0.6, HOME_TILT, "no lease", TIMEOUT)
    realtime.lab.robot.stop("a test")
    with pytest.raises(Stopped, match="a test"):
        realtime.eyes.head.move(0.6, HOME_TILT, realtime.eyes.lease_id, TIMEOUT, realtime.eyes.beat)
    after = realtime.eyes.head.state()
    assert (after.pan, after.tilt, after.moving) == (home.pan, home.tilt, False)


def test_a_head_that_follows_needs_the_lease_and_stands_still_when_the_robot_is_stopped(realtime: There) -> None:
    head, lease_id = realtime.eyes.head, realtime.eyes.lease_id
    home = head.state()
    course = Course(home.pan, home.tilt, 0.2, 0.0, home.world_time)
    with pytest.raises(Unauthorised):
        head.follow(course, 5.0, "no lease", TIMEOUT)
    assert not head.state().moving
    assert head.follow(course, 5.0, lease_id, TIMEOUT).world_time >= home.world_time
    deadline = time.monotonic() + 5.0
    while head.state().pan < home.pan + 0.02:
        assert time.monotonic() < deadline
        realtime.eyes.beat()
        time.sleep(0.01)
    with pytest.raises(OutOfLimits, match="pan"):
        head.follow(Course(9.0, 0.0, 0.0, 0.0, home.world_time), 1.0, lease_id, TIMEOUT)
    assert head.state().moving
    realtime.lab.robot.stop("a test")
    with pytest.raises(Stopped, match="a test"):
        head.follow(course, 5.0, lease_id, TIMEOUT)
    assert not head.state().moving


def test_a_cancelled_head_move_halts_the_head_and_latches_no_stop(realtime: There) -> None:
    head = realtime.eyes.head

    def cancelled_while_it_turns() -> None:
        realtime.eyes.beat()
        if abs(head.state().pan) > 0.05:
            raise Cancelled("a test")

    with pytest.raises(Cancelled, match="a test"):
        head.move(1.2, HOME_TILT, realtime.eyes.lease_id, TIMEOUT, cancelled_while_it_turns)
    halted = head.state()
    assert not halted.moving
    assert 0.05 < halted.pan < 1.1
    deadline = time.monotonic() + 5.0
    while realtime.lab.robot.state().moving:
        assert time.monotonic() < deadline
    assert not realtime.lab.robot.state().stopped
    assert head.state().pan == halted.pan
