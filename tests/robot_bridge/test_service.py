"""The service and the remote robot over a real router, with a robot that has no physics."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Literal

import numpy as np
import pytest
import structlog

from handeye.proto.methods import (
    ROBOT_ACQUIRE_LEASE,
    ROBOT_ADVANCE,
    ROBOT_GET_STATE,
    ROBOT_HEARTBEAT,
    ROBOT_MOVE_TO_JOINTS,
    ROBOT_PARK,
    ROBOT_RELEASE_LEASE,
    ROBOT_STATE,
)
from handeye.proto.v1 import robot_pb2
from handeye.robot_bridge.driver import Pace, RobotState
from handeye.robot_bridge.lease import HEARTBEAT_PERIOD, SILENCE_LIMIT
from handeye.robot_bridge.remote import RemoteRobot, heartbeat
from handeye.robot_bridge.service import RobotService
from handeye.rpc import Bus
from handeye.rpc.errors import Busy, DeadlineExceeded, Slipping, Stopped, Unauthorised, Unavailable
from tests.robot_bridge.fake_robot import FakeRobot

Join = Callable[[str], Bus]
Clock = Literal["realtime", "lockstep"]
FAR, SLOW = np.array([2.0, 1.0, -1.0]), Pace(0.1, 0.5)  # 20 s of world time from park
BOTH_CLOCKS = pytest.mark.parametrize("clock", ["realtime", "lockstep"])


@pytest.fixture
def clock() -> Clock:
    return "realtime"


@pytest.fixture
def fake(clock: Clock) -> FakeRobot:
    fake = FakeRobot(clock)
    if clock == "lockstep":
        fake.wall_step = 0.002  # not as fast as it goes: a motion that takes no time cannot be met in its middle
    return fake


@pytest.fixture(autouse=True)
def service(fake: FakeRobot, join: Join) -> Iterator[RobotService]:
    with RobotService(fake, join("robot-bridge")) as service:
        yield service


@pytest.fixture
def robot(join: Join, service: RobotService) -> RemoteRobot:
    return RemoteRobot(join("coordinator"), "coordinator")


@contextmanager
def in_background(action: Callable[[], object]) -> Iterator[list[BaseException]]:
    """Runs `action` in a thread that has ended when the block has; what it raised is in the list then."""
    raised: list[BaseException] = []

    def run() -> None:
        try:
            action()
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield raised
    finally:
        thread.join(10.0)
        assert not thread.is_alive()


def wait_until(condition: Callable[[], bool], timeout: float = 5.0) -> None:
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, "it did not happen in time"
        time.sleep(0.005)


class OnceAt:
    """A watch that does something once, when the motion has begun."""

    def __init__(self, action: Callable[[], object]) -> None:
        self.action = action
        self.done = False

    def __call__(self, fraction: float) -> None:
        if fraction > 0.0 and not self.done:
            self.done = True
            self.action()


# Lease


def test_the_second_is_refused_until_the_first_gives_it_back(robot: RemoteRobot, join: Join) -> None:
    other = RemoteRobot(join("teacher"), "teacher")
    with robot.lease():
        assert robot.lease_id
        assert other.state().lease_holder == "coordinator"
        with pytest.raises(Busy, match="'coordinator' holds the control lease"), other.lease():
            pass
        robot.park()
    assert robot.lease_id == ""
    with other.lease():
        assert robot.state().lease_holder == "teacher"
    assert robot.state().lease_holder == ""


def test_without_a_lease_nothing_moves(robot: RemoteRobot, join: Join, fake: FakeRobot) -> None:
    with pytest.raises(Unauthorised, match="needs the control lease"):
        robot.park()
    raw = join("stranger")
    with robot.lease():
        for wrong in ("", "0" * 32):
            with pytest.raises(Unauthorised, match="'coordinator' holds"):
                raw.call(ROBOT_PARK, robot_pb2.ParkRequest(lease_id=wrong), timeout=1.0)
            with pytest.raises(Unauthorised):
                raw.call(ROBOT_RELEASE_LEASE, robot_pb2.ReleaseLeaseRequest(lease_id=wrong), timeout=1.0)
            with pytest.raises(Unauthorised):
                raw.call(ROBOT_ADVANCE, robot_pb2.AdvanceRequest(lease_id=wrong, duration=1.0), timeout=1.0)
    assert fake.time == 0.0


def test_the_lease_says_when_heartbeats_are_due(join: Join) -> None:
    lease = join("teacher").call(ROBOT_ACQUIRE_LEASE, robot_pb2.AcquireLeaseRequest(holder="teacher"), timeout=1.0)
    assert (lease.heartbeat_period, lease.silence_limit) == (HEARTBEAT_PERIOD, SILENCE_LIMIT)


def test_a_lease_given_back_during_a_motion_brakes(robot: RemoteRobot, join: Join) -> None:
    stranger = join("stranger")
    with robot.lease():
        request = robot_pb2.ReleaseLeaseRequest(lease_id=robot.lease_id)
        with in_background(lambda: robot.move_to_joints(FAR, SLOW)) as raised:
            wait_until(lambda: robot.state().moving)
            assert not stranger.call(ROBOT_RELEASE_LEASE, request, timeout=2.0).moving
        assert isinstance(raised[0], Unauthorised)
        assert "'coordinator' gave the control lease back" in str(raised[0])
    assert not robot.state().stopped


# Motion


@BOTH_CLOCKS
def test_what_was_reached_comes_back(robot: RemoteRobot, fake: FakeRobot) -> None:
    target = np.array([0.2, 0.1, 0.0])
    with robot.lease():
        reached = robot.move_to_joints(target, Pace(1.0, 1.0))
    assert reached.joints == pytest.approx(target)
    assert reached.lease_holder == "coordinator"
    assert reached.world_time == fake.time
    assert not reached.moving


def test_progress_rises_and_comes_at_most_20_times_a_second(robot: RemoteRobot, join: Join) -> None:
    reports: list[robot_pb2.MotionProgress] = []
    bus = join("teacher")
    lease = bus.call(ROBOT_ACQUIRE_LEASE, robot_pb2.AcquireLeaseRequest(holder="teacher"), timeout=1.0)
    request = robot_pb2.MoveToJointsRequest(
        lease_id=lease.lease_id, joints=[0.5, -0.5, 0.5], pace=robot_pb2.Pace(speed=0.5)
    )
    began = time.monotonic()
    bus.call(
        ROBOT_MOVE_TO_JOINTS,
        request,
        timeout=10.0,
        on_progress=reports.append,
        on_tick=heartbeat(bus, lease.lease_id),
    )
    seconds = time.monotonic() - began
    fractions = [report.fraction for report in reports]
    assert 10 <= len(reports) <= 20 * seconds + 1
    assert fractions == sorted(fractions)
    assert all(report.state.moving for report in reports)
    assert reports[-1].state.joints[0] > reports[0].state.joints[0]


def test_a_second_motion_is_refused_while_one_is_under_way(robot: RemoteRobot) -> None:
    def second() -> None:
        with pytest.raises(Busy, match="motion is under way"):
            robot.advance(0.1)
        with pytest.raises(Busy):
            robot.reset()

    watch = OnceAt(second)
    with robot.lease():
        robot.move_to_joints(np.array([0.5, -0.5, 0.5]), Pace(), watch)
    assert watch.done


@BOTH_CLOCKS
def test_an_exception_of_the_watch_brakes_the_arm_and_leaves_the_command(robot: RemoteRobot, clock: Clock) -> None:
    class Enough(Exception):
        pass

    def watch(fraction: float) -> None:
        if fraction > 0.0:
            raise Enough

    with robot.lease():
        with pytest.raises(Enough):
            robot.advance(60.0, watch) if clock == "lockstep" else robot.move_to_joints(FAR, SLOW, watch)
        state = robot.state()
        assert not state.moving
        assert not state.stopped
        robot.advance(0.01)  # and the next command is welcome at once


def test_a_deadline_brakes(join: Join, robot: RemoteRobot) -> None:
    bus = join("teacher")
    lease = bus.call(ROBOT_ACQUIRE_LEASE, robot_pb2.AcquireLeaseRequest(holder="teacher"), timeout=1.0)
    with pytest.raises(DeadlineExceeded):
        bus.call(
            ROBOT_MOVE_TO_JOINTS,
            robot_pb2.MoveToJointsRequest(lease_id=lease.lease_id, joints=FAR),
            timeout=0.2,
            on_tick=heartbeat(bus, lease.lease_id),
        )
    wait_until(lambda: not robot.state().moving, 0.5)
    assert not robot.state().stopped


# Stop and reset


@BOTH_CLOCKS
def test_anyone_may_stop_a_motion_and_it_stays_stopped(robot: RemoteRobot, join: Join, clock: Clock) -> None:
    passer_by = RemoteRobot(join("passer-by"))
    watch = OnceAt(lambda: passer_by.stop("a hand in the way"))
    with robot.lease():
        with pytest.raises(Stopped, match="a hand in the way"):
            robot.advance(60.0, watch) if clock == "lockstep" else robot.move_to_joints(FAR, SLOW, watch)
        assert robot.state().stopped
        with pytest.raises(Stopped, match="a hand in the way"):
            robot.park()
        assert not passer_by.reset().stopped
        robot.advance(0.01)


def test_a_stop_without_a_reason_names_the_caller(robot: RemoteRobot, join: Join) -> None:
    RemoteRobot(join("passer-by")).stop()
    with robot.lease(), pytest.raises(Stopped, match="stopped by passer-by"):
        robot.park()


def test_the_end_of_the_service_ends_the_motion(robot: RemoteRobot, service: RobotService, fake: FakeRobot) -> None:
    with robot.lease(), in_background(lambda: robot.move_to_joints(FAR, SLOW)) as raised:
        wait_until(lambda: robot.state().moving)
        service.__exit__(None, None, None)
    assert isinstance(raised[0], Stopped | Unavailable)
    assert not fake.state().moving
    assert fake.state().stopped


# Silence


@pytest.mark.parametrize(("clock", "least", "most"), [("realtime", 0.1, 0.9), ("lockstep", 1.0, 2.0)])
def test_a_silent_holder_brakes_the_arm_and_latches_the_stop(
    robot: RemoteRobot, join: Join, fake: FakeRobot, least: float, most: float
) -> None:
    bus = join("teacher")
    lease = bus.call(ROBOT_ACQUIRE_LEASE, robot_pb2.AcquireLeaseRequest(holder="teacher"), timeout=1.0)
    request = robot_pb2.AdvanceRequest(lease_id=lease.lease_id, duration=60.0)
    began = time.monotonic()
    with pytest.raises(Stopped, match=r"the lease holder 'teacher' has been silent for \d\.\d\d s"):
        bus.call(ROBOT_ADVANCE, request, timeout=5.0)
    assert least <= time.monotonic() - began < most
    assert fake.time < 0.4, "the world went on without its holder"
    state = robot.state()
    assert (state.moving, state.stopped, state.lease_holder) == (False, True, "teacher")


@pytest.mark.parametrize("clock", ["lockstep"])
def test_in_lockstep_the_world_waits_for_a_holder_that_pauses(join: Join, fake: FakeRobot) -> None:
    bus = join("teacher")
    lease = bus.call(ROBOT_ACQUIRE_LEASE, robot_pb2.AcquireLeaseRequest(holder="teacher"), timeout=1.0)
    beat = heartbeat(bus, lease.lease_id)
    times: list[float] = []

    def on_tick() -> None:
        beat()
        if fake.time > 0.1 and not times:
            time.sleep(0.3)  # the pause under test
            times.append(fake.time)
            time.sleep(0.3)
            times.append(fake.time)

    reached = bus.call(
        ROBOT_ADVANCE,
        robot_pb2.AdvanceRequest(lease_id=lease.lease_id, duration=1.0),
        timeout=10.0,
        on_tick=on_tick,
    )
    assert times[0] == times[1], "the world went on"
    assert reached.world_time == pytest.approx(1.0, abs=0.01)
    assert not reached.stopped


@pytest.mark.parametrize("clock", ["lockstep"])
def test_a_cancel_reaches_a_world_that_waits(join: Join, fake: FakeRobot, robot: RemoteRobot) -> None:
    bus = join("teacher")
    lease = bus.call(ROBOT_ACQUIRE_LEASE, robot_pb2.AcquireLeaseRequest(holder="teacher"), timeout=1.0)
    with pytest.raises(DeadlineExceeded):
        bus.call(ROBOT_ADVANCE, robot_pb2.AdvanceRequest(lease_id=lease.lease_id, duration=60.0), timeout=0.3)
    wait_until(lambda: not robot.state().moving, 0.3)
    assert not robot.state().stopped


def test_a_holder_at_rest_needs_no_heartbeat_until_somebody_else_wants_the_lease(
    robot: RemoteRobot, join: Join
) -> None:
    other = RemoteRobot(join("teacher"), "teacher")
    with robot.lease():
        robot.park()
        time.sleep(0.5)  # silence at rest
        robot.advance(0.01)
        deadline = time.monotonic() + 4.0
        while True:
            try:
                with other.lease():
                    with pytest.raises(Unauthorised, match="'teacher' holds"):
                        robot.park()
                    break
            except Busy:
                assert time.monotonic() < deadline
                time.sleep(0.05)
    # the end of `robot.lease()` had nothing left to give back and says so in the log only


# State


@BOTH_CLOCKS
def test_the_state_stream_has_50_hz_also_while_the_arm_moves(robot: RemoteRobot, join: Join) -> None:
    times: list[float] = []
    with join("console").subscribe(ROBOT_STATE, lambda _: times.append(time.monotonic())), robot.lease():
        wait_until(lambda: bool(times))
        times.clear()
        began = time.monotonic()
        robot.advance(0.5)
        while time.monotonic() - began < 1.0:
            robot.advance(0.02)
    assert len(times) >= 50


def test_state_is_had_without_a_lease_and_at_any_time(robot: RemoteRobot, join: Join) -> None:
    bus = join("console")
    seen: list[bool] = []
    watch = OnceAt(lambda: seen.append(bus.call(ROBOT_GET_STATE, robot_pb2.GetStateRequest(), timeout=1.0).moving))
    with robot.lease():
        robot.move_to_joints(np.array([0.5, -0.5, 0.5]), Pace(), watch)
    assert seen == [True]
    assert np.isfinite(robot.state().still_since)


def test_heartbeats_of_others_do_not_count(join: Join, robot: RemoteRobot) -> None:
    bus, stranger = join("teacher"), join("stranger")
    lease = bus.call(ROBOT_ACQUIRE_LEASE, robot_pb2.AcquireLeaseRequest(holder="teacher"), timeout=1.0)
    request = robot_pb2.AdvanceRequest(lease_id=lease.lease_id, duration=5.0)
    wrong = heartbeat(stranger, "0" * 32)
    with pytest.raises(Stopped, match="'teacher' has been silent"):
        bus.call(ROBOT_ADVANCE, request, timeout=5.0, on_tick=wrong)


def test_no_stream_carries_the_lease(robot: RemoteRobot, join: Join) -> None:
    console = join("console")
    heard: dict[str, list[bytes]] = {"heartbeat": [], "state": []}
    with (
        console.subscribe(ROBOT_HEARTBEAT, lambda beat: heard["heartbeat"].append(beat.SerializeToString())),
        console.subscribe(ROBOT_STATE, lambda state: heard["state"].append(state.SerializeToString())),
        robot.lease(),
    ):
        lease_id = robot.lease_id
        for part in heard.values():
            part.clear()
        robot.advance(0.1)
        wait_until(lambda: all(heard.values()))
        assert not [said for said in heard["heartbeat"] + heard["state"] if lease_id.encode() in said]


def test_the_state_stream_survives_whatever_a_driver_raises(join: Join, fake: FakeRobot) -> None:
    newest: list[float] = []
    state, failures = fake.state, [ValueError("no number"), OSError("no cable")]

    def failing() -> RobotState:
        if failures:
            raise failures.pop()
        return state()

    with (
        structlog.testing.capture_logs() as logs,
        join("console").subscribe(ROBOT_STATE, lambda message: newest.append(message.world_time)),
    ):
        wait_until(lambda: bool(newest))
        fake.state = failing  # type: ignore[method-assign]
        wait_until(lambda: not failures)
        newest.clear()
        wait_until(lambda: bool(newest))
    assert [(log["event"], log["exc_info"]) for log in logs] == [("no state to publish", True)]


def test_no_lease_id_is_logged(join: Join, capsys: pytest.CaptureFixture[str]) -> None:
    robot = RemoteRobot(join("coordinator"), "coordinator")
    with robot.lease():
        lease_id = robot.lease_id
        robot.stop("for the log")
        with pytest.raises(Stopped):
            robot.park()
    logged = "".join(capsys.readouterr())
    assert "for the log" in logged
    assert lease_id not in logged


def test_what_slips_is_felt_at_the_robot(robot: RemoteRobot, fake: FakeRobot) -> None:
    with robot.lease():
        held = robot.close_gripper().gripper_opening
        fake._opening = 0.03
        with pytest.raises(Slipping):
            robot.adjust_joints(FAR - fake.state().joints, SLOW, least_opening=0.031)
        assert held < 0.03
        assert not robot.state().stopped
