"""A taught stack: what the acting side may know, and how tasks end that can't be done."""

from __future__ import annotations

import os
import signal
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import pytest
import zenoh

from handeye.cli.up import Stack
from handeye.proto.methods import LAB_GET_WORLD
from handeye.proto.v1 import lab_pb2
from handeye.robot_bridge.remote import RemoteRobot
from handeye.rpc import Bus, LabBusSettings
from handeye.rpc.errors import Busy, Unauthorised, Unavailable
from handeye.rpc.settings import client_config
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.scoring import Track
from handeye.simulation.teaching import acting_settings, lab_settings
from tests.system.positions import carries

if TYPE_CHECKING:
    from tests.system.conftest import Lesson

# The first test's time includes starting and teaching the stack.
pytestmark = [pytest.mark.system, pytest.mark.timeout(400)]


@contextmanager
def everything(stack: Stack) -> Iterator[list[tuple[str, bytes]]]:
    """Whatever a subscriber to `**` with acting credentials receives: (key, payload)."""
    received: list[tuple[str, bytes]] = []

    def keep(sample: zenoh.Sample) -> None:
        received.append((str(sample.key_expr), sample.payload.to_bytes()))

    with (
        zenoh.open(client_config(acting_settings(stack.acting), 3.0)) as session,
        session.declare_subscriber("**", keep),
    ):
        yield received


def test_a_trial_passes_and_the_acting_bus_carries_no_truth(lesson: Lesson) -> None:
    lesson.reset()
    lesson.place()
    begun = lesson.lab.world()
    before = begun.object("blue cup").pose.position
    with everything(lesson.stack) as received:
        code, said = lesson.run()
    assert code == 0, said
    after = lesson.lab.world().object("blue cup").pose.position
    assert after[2] - before[2] > 0.10
    cup = Track.of(lesson.lab.history(begun.world_time, every=0.02), "blue cup").cup
    assert len(received) > 50
    assert not [key for key, _ in received if "lab" in key.lower()]
    # Nowhere that the cup has been, in no message; and no single number of where it was at first and at last.
    assert not {key for key, payload in received if carries(payload, cup)}
    numbers = [struct.pack("<d", value) for value in (*before, *after)]
    assert not [key for key, payload in received for number in numbers if number in payload]
    # The search would have found them: the lab's own answer holds them.
    with Bus.open(lab_settings(lesson.stack.lab), name="tests") as lab:
        truth = lab.call(LAB_GET_WORLD, lab_pb2.GetWorldRequest(world_time=-1.0), timeout=2.0).SerializeToString()
    assert struct.pack("<d", after[0]) in truth
    assert carries(truth, after[None])
    assert not carries(truth, after[None] + 1e-3)


@pytest.mark.parametrize("kind", ["<f8", "<f4"])
@pytest.mark.parametrize("tag", [b"", b"!"])
@pytest.mark.parametrize("before", range(9))
def test_a_position_is_found_at_any_byte_of_a_message(kind: str, tag: bytes, before: int) -> None:
    position = np.array([0.612345, -0.0987654, 0.0451])
    message = b"\xff" * before + b"".join(tag + np.array(axis, kind).tobytes() for axis in position) + b"\xff" * 3
    assert carries(message, position[None])
    assert not carries(message, position[None] + 1e-3)


def test_the_acting_bus_does_not_lead_to_the_lab(stack: Stack) -> None:
    with Bus.open(acting_settings(stack.acting), name="spy") as bus, pytest.raises(Unavailable):
        bus.call(LAB_GET_WORLD, lab_pb2.GetWorldRequest(world_time=-1.0), timeout=2.0)


@pytest.mark.parametrize("credentials", ["acting", "none"])
def test_the_lab_bus_refuses_whoever_has_not_its_credentials(stack: Stack, credentials: str) -> None:
    lab = lab_settings(stack.lab)
    settings = LabBusSettings(endpoint=lab.endpoint)
    if credentials == "acting":
        acting = acting_settings(stack.acting)
        settings = LabBusSettings(endpoint=lab.endpoint, user=acting.user, password=acting.password)
    with pytest.raises(Unauthorised):
        Bus.open(settings, name="spy", timeout=1.0).close()


def test_the_server_is_given_no_way_to_the_lab(stack: Stack) -> None:
    server = next(child for child in stack.supervisor.children if child.name == "server")
    with open(f"/proc/{server.pid}/environ", "rb") as environment:
        content = environment.read()
    assert b"HANDEYE_BUS_PASSWORD" in content
    assert b"LAB" not in content
    assert stack.lab["HANDEYE_LAB_BUS_PASSWORD"].encode() not in content


def expect_refusal(lesson: Lesson, *words: str, meanwhile: Callable[[], None] = lambda: None) -> None:
    """`handeye run` ends with exit code 1 and a message with these words, and the arm is stopped."""
    code, said = lesson.run(meanwhile)
    assert code == 1, said
    for word in words:
        assert word in said
    assert "Traceback" not in said
    state = lesson.client.robot()
    assert state.stopped
    assert not state.moving


def test_a_missing_object_ends_the_task(lesson: Lesson) -> None:
    lesson.reset()
    expect_refusal(lesson, "blue cup", "not seen")


def test_a_hidden_hand_ends_the_task(lesson: Lesson) -> None:
    lesson.reset()
    lesson.place((0.6, 0.14))
    # A tall grey drum between the parked hand and the cameras; the cup stands beside it.
    drum = ObjectSpec("drum", "cup", radius=0.11, height=0.45, wall=0.01, mass=2.0, color=(0.5, 0.5, 0.5))
    lesson.place((0.65, -0.02), drum)
    expect_refusal(lesson, "hand", "not seen")


def test_a_cup_out_of_reach_ends_the_task(lesson: Lesson) -> None:
    lesson.reset()
    lesson.place((0.86, 0.0))  # as far as it is still recognised
    before = lesson.lab.world().object("blue cup").pose.position
    expect_refusal(lesson, "failed in subtask")  # outside the taught region, or refused by the robot
    assert np.linalg.norm(lesson.lab.world().object("blue cup").pose.position - before) < 1e-3


def test_a_coordinator_that_falls_silent_is_stopped(lesson: Lesson) -> None:
    lesson.reset()
    lesson.place()
    server = lesson.process("server")

    with Bus.open(acting_settings(lesson.stack.acting), name="tests") as bus:
        robot = RemoteRobot(bus, "tests")

        def freeze() -> None:
            # The world of a frozen coordinator stands still: an arm that moved goes on showing it until it is stopped.
            # A motion may have ended just before; then the coordinator is let go on to the next one.
            for _ in range(20):
                lesson.catch_in_motion(lambda: os.kill(server, signal.SIGSTOP))
                try:
                    deadline = time.monotonic() + 5.0
                    while max(map(abs, robot.state().velocities)) > 1e-2:
                        assert time.monotonic() < deadline, "the bridge did not stop the arm"
                        time.sleep(0.02)
                    if robot.state().stopped:
                        return
                finally:
                    os.kill(server, signal.SIGCONT)
            raise AssertionError("the coordinator was never caught in a motion")

        # In which subtask it is caught is a matter of the machine's speed.
        expect_refusal(lesson, "failed in subtask", meanwhile=freeze)
        log = (lesson.stack.state_dir / "logs" / "robot-bridge.log").read_text()
        assert "the lease holder 'coordinator' has been silent" in log

        def lease_is_free() -> bool:
            try:
                with robot.lease():
                    return True
            except Busy:
                return False

        deadline = time.monotonic() + 5.0
        while not lease_is_free():
            assert time.monotonic() < deadline, "a silent holder kept the lease"
            time.sleep(0.1)


def test_a_camera_bridge_killed_in_mid_task_ends_it(lesson: Lesson) -> None:
    """The last test of this file: afterwards the stack is of no use."""
    lesson.reset()
    lesson.place()

    def kill() -> None:
        camera_bridge = lesson.process("camera bridge")
        lesson.catch_in_motion(lambda: os.kill(camera_bridge, signal.SIGKILL))

    expect_refusal(lesson, "Camera", "nobody serves it", meanwhile=kill)
