"""A client on another machine (a network namespace of its own), and a coordinator that is killed in mid-task."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from handeye.cli.up import Stack
from handeye.client import Client
from handeye.client.models import Job, RunJob
from handeye.robot_bridge.remote import RemoteRobot
from handeye.rpc import Bus
from handeye.simulation.lab import LabClient
from handeye.simulation.objects import CUPS
from handeye.simulation.places import Purpose, draw
from handeye.simulation.teaching import acting_settings, lab_settings
from tests.system.remote_lesson import OBJECT, SEED, TASK

pytestmark = [pytest.mark.system, pytest.mark.timeout(400)]

NAMESPACE = f"handeye{os.getpid()}"
HERE, THERE = "10.219.47.1", "10.219.47.2"


def ip(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["ip", *words], capture_output=True, text=True, timeout=10, check=False)


@pytest.fixture(scope="module")
def namespace() -> Iterator[str]:
    """A network namespace that reaches this machine at `HERE`, by a cable of its own."""
    if shutil.which("ip") is None:
        pytest.skip("there is no `ip`: apt-get install iproute2")
    made = ip("netns", "add", NAMESPACE)
    if made.returncode != 0:
        pytest.skip(f"no network namespace can be made here: {made.stderr.strip()}")
    ours, theirs = f"he{os.getpid() % 100000}a", f"he{os.getpid() % 100000}b"
    try:
        for words in (
            ("link", "add", ours, "type", "veth", "peer", "name", theirs, "netns", NAMESPACE),
            ("address", "add", f"{HERE}/30", "dev", ours),
            ("link", "set", ours, "up"),
            ("-n", NAMESPACE, "address", "add", f"{THERE}/30", "dev", theirs),
            ("-n", NAMESPACE, "link", "set", theirs, "up"),
        ):
            done = ip(*words)
            if done.returncode != 0:
                pytest.skip(f"no cable can be laid between namespaces here: {done.stderr.strip()}")
        yield NAMESPACE
    finally:
        ip("netns", "delete", NAMESPACE)  # the cable goes with it


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory, namespace: str) -> Iterator[Stack]:
    with pytest.MonkeyPatch.context() as patch:
        # Slow motions, so that a test can catch the arm in the midst of one.
        patch.setenv("HANDEYE_SERVER_ACTING__PACE", "0.1")
        with Stack(tmp_path_factory.mktemp("state")) as stack:
            # This coordinator listens on loopback only, as it does unless told otherwise.
            end_server(stack)
            restart(stack, HERE)
            yield stack


def end_server(stack: Stack) -> None:
    server = next(child for child in stack.supervisor.children if child.name == "server")
    server.terminate()
    stack.supervisor.finish(server)


def restart(stack: Stack, host: str) -> None:
    stack.server["HANDEYE_SERVER_HOST"] = host
    stack.url = f"http://{host}:{stack.server['HANDEYE_SERVER_PORT']}"
    stack.start_verb("server", environment=stack.server)
    stack.wait_ready()


@contextmanager
def lab_of(stack: Stack) -> Iterator[LabClient]:
    with Bus.open(lab_settings(stack.lab), name="tests") as bus:
        yield LabClient(bus)


def answer(lab: LabClient, request: dict[str, Any]) -> Any:
    """What a person in the laboratory does or sees."""
    match request["do"]:
        case "reset":
            lab.reset(request["seed"])
            return None
        case "place":
            lab.place(CUPS[request["name"]], request["xy"], request["yaw"])
            return None
        case "see":
            return lab.world().object(request["name"]).pose.position.tolist()
        case other:
            raise AssertionError(other)


def test_a_client_elsewhere_teaches_trains_runs_and_reads_back_why(stack: Stack, namespace: str) -> None:
    script = Path(__file__).with_name("remote_lesson.py")
    environment = os.environ | {"HANDEYE_URL": stack.url, "HANDEYE_TOKEN": stack.token}
    command = ["ip", "netns", "exec", namespace, sys.executable, str(script)]
    with (
        lab_of(stack) as lab,
        subprocess.Popen(
            command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as remote,
    ):
        assert remote.stdin is not None
        assert remote.stdout is not None
        assert remote.stderr is not None
        report: dict[str, Any] = {}
        try:
            for line in remote.stdout:
                request = json.loads(line)
                if "report" in request:
                    report = request["report"]
                    continue
                print(json.dumps(answer(lab, request)), file=remote.stdin, flush=True)
            assert remote.wait(30.0) == 0, remote.stderr.read()
        finally:
            remote.kill()
    # Looks of approach (14 of them elsewhere) and grasp, of the lift towards its goal and its way, of the hold.
    assert report["pairs"] == 2 * (30 + 14 + 2 * 3 + 2)
    assert report["moves"] >= 2
    assert set(report["reasons"]) == {"grasp-1", "grasp-2"}
    assert report["support"] > 0.2
    assert min(report["pictures"]) > 10_000
    assert report["lifted"] > 0.1


def looks_of(job: Job) -> int:
    """How many looks a run has made so far."""
    assert isinstance(job, RunJob)
    return sum(len(subtask.looks) for subtask in job.result.subtasks) if job.result else 0


def kill_in_motion(stack: Stack, robot: RemoteRobot) -> None:
    """Kills the coordinator while the arm is in motion: it is held still until that is certain."""
    server = next(child for child in stack.supervisor.children if child.name == "server")
    for _ in range(1000):
        os.kill(server.pid, signal.SIGSTOP)
        # Without heartbeats the world stands still after 0.1 s, and the motion is given up after 1 s: what still moves
        # now was not about to end.
        time.sleep(0.3)
        if robot.state().moving:
            break
        os.kill(server.pid, signal.SIGCONT)
        time.sleep(0.02)
    else:
        raise AssertionError("the arm was never caught in motion")
    os.kill(server.pid, signal.SIGKILL)
    stack.supervisor.children.remove(server)
    server.end(time.monotonic() + 5.0)


def test_a_coordinator_killed_in_mid_task_loses_nothing(stack: Stack) -> None:
    place = draw(SEED, Purpose.TEACHING, 2)[0]
    with lab_of(stack) as lab, Bus.open(acting_settings(stack.acting), name="tests") as bus:
        lab.reset(5)
        lab.place(CUPS[OBJECT], (place.x, place.y), 0.4)
        with Client(stack.url, stack.token) as client:
            if client.robot().stopped:
                client.reset_robot()
            before = client.demonstrations(), client.tasks()
            job = client.start_run(TASK, OBJECT)
            while not (looks := looks_of(client.job(job.id))):
                time.sleep(0.02)
        robot = RemoteRobot(bus, "tests")
        kill_in_motion(stack, robot)
        # Nobody stops the arm: it stops because nobody moves it any more.
        deadline = time.monotonic() + 10.0
        while not (state := robot.state()).stopped or state.moving:
            assert time.monotonic() < deadline, "the arm went on without anybody"
            time.sleep(0.05)
        assert bus.is_alive("Robot")
        assert bus.is_alive("Camera")
    restart(stack, HERE)
    with Client(stack.url, stack.token) as client:
        found = client.job(job.id)
        assert found.state == "interrupted"
        assert found.error is not None
        assert found.error.code == "interrupted"
        assert looks_of(found) >= looks
        assert [event.data["state"] for event in client.events(job.id) if event.kind == "state"][-1] == "interrupted"
        assert (client.demonstrations(), client.tasks()) == before
        # Control is free two seconds after the dead holder's last heartbeat, and the task can be done.
        client.reset_robot()
        with lab_of(stack) as lab:
            lab.reset(5)
            lab.place(CUPS[OBJECT], (place.x, place.y), 0.4)
        assert client.run_task(TASK, OBJECT).raise_for_failure().succeeded
    end_server(stack)  # the last test of this file: this one's processes are to be gone
