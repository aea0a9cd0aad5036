from __future__ import annotations

import threading

import pytest

from handeye.robot_bridge.lease import TAKEOVER_AFTER, LeaseKeeper, lease_digest
from handeye.rpc.errors import Busy, InvalidArgument, Unauthorised


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def leases(clock: Clock) -> LeaseKeeper:
    return LeaseKeeper(clock)


def test_the_first_gets_it_and_the_second_hears_whose_it_is(leases: LeaseKeeper) -> None:
    lease_id = leases.acquire("teacher")
    assert leases.holder == "teacher"
    with pytest.raises(Busy, match="'teacher' holds the control lease") as refused:
        leases.acquire("coordinator")
    assert lease_id not in str(refused.value) + refused.value.detail
    leases.check(lease_id)


def test_ids_are_long_and_never_the_same(leases: LeaseKeeper) -> None:
    ids = set()
    for _ in range(50):
        lease_id = leases.acquire("teacher")
        leases.release(lease_id)
        ids.add(lease_id)
    assert len(ids) == 50
    assert min(map(len, ids)) >= 32


def test_a_silent_lease_may_be_taken_over_and_is_then_lost(leases: LeaseKeeper, clock: Clock) -> None:
    old = leases.acquire("teacher")
    clock.now += TAKEOVER_AFTER - 0.01
    with pytest.raises(Busy):
        leases.acquire("coordinator")
    clock.now += 0.02
    new = leases.acquire("coordinator")
    leases.check(new)
    with pytest.raises(Unauthorised, match="'coordinator' holds"):
        leases.check(old)


def test_a_heartbeat_keeps_it_and_only_the_holders_counts(leases: LeaseKeeper, clock: Clock) -> None:
    lease_id = leases.acquire("teacher")
    clock.now += 1.5
    for wrong in ("somebody else's", "", lease_digest("somebody else's"), lease_id):
        leases.beat(wrong)
        assert leases.silence(lease_id) == 1.5
    leases.beat(lease_digest(lease_id))
    assert leases.silence(lease_id) == 0.0
    clock.now += 1.5
    with pytest.raises(Busy):
        leases.acquire("coordinator")


def test_nobody_takes_it_over_during_a_motion(leases: LeaseKeeper, clock: Clock) -> None:
    lease_id = leases.acquire("teacher")
    with leases.in_use(lease_id):
        clock.now += 10 * TAKEOVER_AFTER
        with pytest.raises(Busy):
            leases.acquire("coordinator")
    leases.acquire("coordinator")


def test_a_motion_begins_with_a_sign_of_life(leases: LeaseKeeper, clock: Clock) -> None:
    lease_id = leases.acquire("teacher")
    clock.now += 1.0
    with leases.in_use(lease_id):
        assert leases.silence(lease_id) == 0.0


def test_a_released_lease_is_worth_nothing(leases: LeaseKeeper) -> None:
    lease_id = leases.acquire("teacher")
    leases.release(lease_id)
    assert leases.holder == ""
    for use in (leases.check, leases.release, leases.silence):
        with pytest.raises(Unauthorised, match="nobody holds"):
            use(lease_id)
    with pytest.raises(Unauthorised), leases.in_use(lease_id):
        pass


@pytest.mark.parametrize("wrong", ["", "0" * 32, "ümlaut"])
def test_a_wrong_id_is_refused(leases: LeaseKeeper, wrong: str) -> None:
    leases.acquire("teacher")
    with pytest.raises(Unauthorised):
        leases.check(wrong)


@pytest.mark.parametrize("name", ["", "  "])
def test_a_holder_needs_a_name(leases: LeaseKeeper, name: str) -> None:
    with pytest.raises(InvalidArgument):
        leases.acquire(name)


def test_a_waiting_motion_wakes_with_the_heartbeat(leases: LeaseKeeper) -> None:
    lease_id = leases.acquire("teacher")
    woken = threading.Event()

    def wait() -> None:
        leases.wait(10.0)
        woken.set()

    waiter = threading.Thread(target=wait)
    waiter.start()
    while not woken.wait(0.01):  # bounded by the wait's own 10 s
        leases.beat(lease_digest(lease_id))
    waiter.join()
