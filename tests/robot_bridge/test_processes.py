"""A real router, a real robot bridge with the simulated robot, and a lease holder that freezes or dies."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from handeye.proto.methods import LAB_DESCRIBE_SCENE
from handeye.proto.v1 import lab_pb2
from handeye.robot_bridge.driver import Pace, RobotState
from handeye.robot_bridge.remote import RemoteRobot
from handeye.rpc import Bus, BusSettings, LabBusSettings
from handeye.rpc.errors import Busy, Stopped, Unauthorised, Unavailable
from tests.robot_bridge.conftest import free_endpoint

pytestmark = pytest.mark.system

HANDEYE = [sys.executable, "-m", "handeye.cli.main"]
HOLDER = [sys.executable, str(Path(__file__).with_name("holder.py"))]


@contextmanager
def process(command: list[str], env: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    """A child process; stopped with TERM, or killed when that does not help within 10 s."""
    child = subprocess.Popen(
        command, env={**os.environ, **env}, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True
    )
    with child:
        try:
            yield child
        finally:
            child.send_signal(signal.SIGCONT)
            child.terminate()
            try:
                child.wait(10.0)
            except subprocess.TimeoutExpired:
                child.kill()
                raise


@dataclass(frozen=True)
class Lab:
    """Where the processes of a running lab are."""

    clock: str
    env: dict[str, str]
    bus: Bus


@pytest.fixture(scope="module")
def router_endpoint() -> Iterator[str]:
    endpoint = free_endpoint()
    with process([*HANDEYE, "router"], {"HANDEYE_ROUTER_LISTEN": endpoint}):
        yield endpoint


@pytest.fixture(scope="module", params=["lockstep", "realtime"])
def lab(request: pytest.FixtureRequest, router_endpoint: str) -> Iterator[Lab]:
    env = {
        "HANDEYE_BUS_ENDPOINT": router_endpoint,
        "HANDEYE_LAB_BUS_ENDPOINT": free_endpoint(),
        "HANDEYE_LAB_BUS_USER": "lab",
        "HANDEYE_LAB_BUS_PASSWORD": "secret of the lab",
        "HANDEYE_ROBOT_CLOCK": request.param,
        "HANDEYE_ROBOT_PROFILE": "ideal",
    }
    with ExitStack() as stack:
        stack.enter_context(process([*HANDEYE, "robot-bridge"], env))
        bus = stack.enter_context(Bus.open(BusSettings(endpoint=router_endpoint), "tests", timeout=20.0))
        bus.wait_for("Robot", 20.0)
        yield Lab(request.param, env, bus)


@contextmanager
def lease_when_free(robot: RemoteRobot) -> Iterator[None]:
    """The lease, as soon as whoever held it before has been silent for long enough."""
    deadline = time.monotonic() + 5.0
    with ExitStack() as stack:
        while not robot.lease_id:
            try:
                stack.enter_context(robot.lease())
            except Busy:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.05)
        yield


@pytest.fixture
def robot(lab: Lab) -> RemoteRobot:
    """The robot at park, nothing latched."""
    robot = RemoteRobot(lab.bus, "tests")
    robot.reset()
    with lease_when_free(robot):
        robot.park(Pace(1.0, 1.0))
    return robot


@contextmanager
def moving_holder(lab: Lab, robot: RemoteRobot) -> Iterator[subprocess.Popen[str]]:
    """Another process that holds the lease and moves the arm."""
    pace = {"realtime": "0.1", "lockstep": "0.01"}[lab.clock]  # slow enough to be caught in mid-motion
    with process([*HOLDER, pace], lab.env) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "moving\n"
        began = robot.state()
        wait_for(robot, lambda state: state.moving and abs(state.joints[0] - began.joints[0]) > 1e-3, 10.0)
        yield holder


def wait_for(robot: RemoteRobot, condition, timeout: float) -> RobotState:  # type: ignore[no-untyped-def]
    deadline = time.monotonic() + timeout
    while not condition(state := robot.state()):
        assert time.monotonic() < deadline, f"it did not happen within {timeout} s: {state}"
        time.sleep(0.005)
    return state


@pytest.mark.parametrize("how", [signal.SIGSTOP, signal.SIGKILL])
def test_a_holder_that_freezes_or_dies_leaves_a_standing_arm(lab: Lab, robot: RemoteRobot, how: signal.Signals) -> None:
    limit = {"realtime": 0.1, "lockstep": 1.0}[lab.clock]
    with moving_holder(lab, robot) as holder:
        before = robot.state()
        holder.send_signal(how)
        sent = time.monotonic()
        stopped = wait_for(robot, lambda state: state.stopped, limit + 1.0)
        took = time.monotonic() - sent
        still = wait_for(robot, lambda state: not state.moving, 1.0)
        assert limit - 0.05 <= took
        assert abs(still.joints[0] - before.joints[0]) < 0.2, "the arm went on"
        assert stopped.lease_holder == "holder"
        if lab.clock == "lockstep":
            now = robot.state().world_time
            time.sleep(0.2)
            assert robot.state().world_time == now
            # The world goes at up to some hundred times real time: for 0.1 s as it should, for 1 s if it did not wait.
            assert still.world_time - before.world_time < 30.0
        # Nobody else may move it for 2 s, and then not before a reset.
        with pytest.raises(Busy, match="'holder'"), robot.lease():
            pass
        with lease_when_free(robot), pytest.raises(Stopped, match="'holder' has been silent"):
            robot.park()
        assert time.monotonic() - sent > 1.9
        if how is signal.SIGSTOP:
            holder.send_signal(signal.SIGCONT)
            assert holder.stdout is not None
            said = holder.stdout.readline()
            assert said.startswith(("Stopped the lease holder 'holder' has been silent", "Unavailable")), said
    robot.reset()
    with robot.lease():
        assert robot.park(Pace(1.0, 1.0)).joints == pytest.approx(robot.description.park, abs=0.005)


def test_the_lab_bus_wants_its_own_credentials(lab: Lab) -> None:
    endpoint = lab.env["HANDEYE_LAB_BUS_ENDPOINT"]
    with pytest.raises(Unauthorised):
        Bus.open(LabBusSettings(endpoint=endpoint), "intruder", timeout=1.0).close()
    settings = LabBusSettings(endpoint=endpoint, user="lab", password="secret of the lab")  # type: ignore[arg-type]
    with Bus.open(settings, "tests") as lab_bus:
        scene = lab_bus.call(LAB_DESCRIBE_SCENE, lab_pb2.DescribeSceneRequest(), timeout=2.0)
        assert (scene.clock, scene.profile) == (lab.clock, "ideal")
    with pytest.raises(Unavailable):
        lab.bus.call(LAB_DESCRIBE_SCENE, lab_pb2.DescribeSceneRequest(), timeout=2.0)


def test_the_bridge_ends_when_it_is_told_to_or_its_parent_dies(router_endpoint: str) -> None:
    bus_env = {"HANDEYE_BUS_ENDPOINT": router_endpoint, "HANDEYE_BUS_CELL": "another"}
    lab_env = {"HANDEYE_LAB_BUS_USER": "lab", "HANDEYE_LAB_BUS_PASSWORD": "secret of the lab"}
    env = {**os.environ, **bus_env, **lab_env, "HANDEYE_LAB_BUS_ENDPOINT": free_endpoint()}
    with (
        subprocess.Popen([*HANDEYE, "robot-bridge", "--watch-parent"], env=env, stdin=subprocess.PIPE) as child,
        Bus.open(BusSettings(endpoint=router_endpoint, cell="another"), "tests", timeout=20.0) as bus,
    ):
        try:
            bus.wait_for("Robot", 20.0)
            child.stdin.close()  # type: ignore[union-attr]
            assert child.wait(10.0) == 0
            assert not bus.is_alive("Robot")
        finally:
            child.kill()
