"""The containers as an engineer starts them: shut in, and taught and used from outside. Run by tools/check-compose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from handeye.client import Client
from handeye.simulation.places import Purpose, draw

if TYPE_CHECKING:
    from tests.compose.conftest import Containers

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

SERVICES = {"router", "robot-bridge", "camera-bridge", "server"}
TASK, OBJECT, SEED, TAUGHT = "grasp", "blue cup", 3, 2
PLACE = draw(SEED, Purpose.TEACHING, 1)[0]


def test_each_container_is_shut_in(containers: Containers) -> None:
    found = containers.inspect()
    assert set(found) == SERVICES | {"credentials"}
    for service, container in found.items():
        config, host = container["Config"], container["HostConfig"]
        assert host["ReadonlyRootfs"], service
        assert host["CapDrop"] == ["ALL"], service
        assert not host["CapAdd"], service
        assert not host["Privileged"], service
        assert "no-new-privileges:true" in host["SecurityOpt"], service
        assert host["NetworkMode"] != "host", service
        assert config["User"] not in ("", "0", "root"), service
        assert all(mount["Type"] == "volume" for mount in container["Mounts"]), service
        if service in SERVICES:
            assert container["State"]["Health"]["Status"] == "healthy", service
            assert host["RestartPolicy"]["Name"] == "unless-stopped", service
    published = {port: to for each in found.values() for port, to in each["NetworkSettings"]["Ports"].items() if to}
    assert list(published) == ["8000/tcp"]
    assert {to["HostIp"] for to in published["8000/tcp"]} == {"127.0.0.1"}


def test_what_is_secret_shows_nowhere(containers: Containers, token: str) -> None:
    secrets = [
        containers.inside("robot-bridge", "cat", f"/run/handeye/{name}_password").strip()
        for name in ("acting/handeye_bus", "lab/handeye_lab_bus")
    ]
    assert len(set(secrets)) == 2
    shown = str(containers.inspect()) + containers.compose("logs") + containers.compose("top")
    for secret in [*secrets, token]:
        assert len(secret) >= 32
        assert secret not in shown


def test_credentials_are_made_once(containers: Containers) -> None:
    def state() -> str:
        return containers.inside("robot-bridge", "sh", "-c", "stat -c '%n %i %a' /run/handeye/*/*")

    before = state()
    assert before.count(" 600\n") == 5
    containers.compose("run", "--rm", "-T", "credentials")
    assert state() == before


def test_the_server_has_no_way_to_the_lab(containers: Containers) -> None:
    found = containers.inspect()
    assert not [mount for mount in found["server"]["Mounts"] if mount["Destination"].startswith("/run/handeye/lab")]
    assert containers.inside("server", "ls", "-A", "/run/handeye/lab") == ""
    robot = found["robot-bridge"]["NetworkSettings"]["Networks"]
    addresses = [network["IPAddress"] for network in robot.values()]
    assert len(addresses) == 2
    # From the camera bridge the lab bus answers, at one of these addresses; from the server at none.
    knock = (
        "import socket, sys\n"
        "for host in sys.argv[1:]:\n"
        "    try:\n"
        "        socket.create_connection((host, 7448), timeout=1.0).close()\n"
        "        print(host)\n"
        "    except OSError:\n"
        "        pass\n"
    )
    assert len(containers.inside("camera-bridge", "python", "-c", knock, *addresses, "lab-bus").split()) == 2
    assert containers.inside("server", "python", "-c", knock, *addresses, "lab-bus") == ""


def test_teach_train_query_grasp(containers: Containers, client: Client, token: str) -> None:
    """The person is played by a script in the lab; all the rest is done over HTTP, from outside the containers."""

    def in_the_lab(*verb: str) -> None:
        containers.compose("run", "--rm", "-T", "teacher", *verb, token=token)

    in_the_lab("teach", "--demonstrations", str(TAUGHT), "--seed", str(SEED), "--task", TASK, "--object", OBJECT)

    trained = client.train(TASK)
    assert len(trained.demonstrations) == TAUGHT
    assert trained.pairs > 0

    sample = next(iter(client.samples(trained.module)))
    answers = client.query(trained.module, sample.input)
    assert sample.number in answers.samples[0]
    assert set(answers.demonstrations[0]) <= set(trained.demonstrations)
    np.testing.assert_allclose(answers.outputs[0], sample.output, atol=0.02)

    in_the_lab("place", OBJECT, "--at", str(PLACE.x), str(PLACE.y))
    run = client.run_task(TASK, OBJECT).raise_for_failure()
    assert [part.name for part in run.result.subtasks] == ["approach", "grasp", "lift", "hold"]
    # Why each motion was made can be read back.
    for look in (look for part in run.result.subtasks for look in part.looks):
        assert {neighbour.demonstration for neighbour in look.neighbours} <= set(trained.demonstrations)
        assert 0.0 <= look.support <= 1.0
        assert client.picture(look.picture).startswith(b"\xff\xd8")
    assert 0.0 < client.robot().gripper_opening < 0.08, "the fingers hold something"


def test_the_server_restarts_alone(containers: Containers, client: Client) -> None:
    """What was taught and done is kept; robot and cameras go on as if nothing had happened."""
    run = client.jobs()[0]
    before, world_time = containers.inspect(), client.robot().world_time
    assert world_time > 0.0
    containers.compose("restart", "server")
    client.wait_ready(60.0)
    after = containers.inspect()
    assert after["server"]["State"]["StartedAt"] != before["server"]["State"]["StartedAt"]
    for service in SERVICES - {"server"}:
        assert after[service]["State"]["StartedAt"] == before[service]["State"]["StartedAt"], service
    assert client.robot().world_time >= world_time
    assert client.job(run.id) == run
    assert len(client.task(TASK).demonstrations) == TAUGHT
