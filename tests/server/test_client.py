"""The Python client against the real application, over a real connection."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import closing
from typing import TYPE_CHECKING

import numpy as np
import pytest

from handeye.client import ApiError, Client, JobFailed, TimedOut, Unreachable
from handeye.server.app import create_app
from handeye.server.serve import http_server

if TYPE_CHECKING:
    from handeye.client.models import JobEvent
    from tests.server.conftest import Lab

TOKEN = "a-token-for-tests"


@pytest.fixture
def url(lab: Lab) -> Iterator[str]:
    stop = threading.Event()
    with (
        closing(socket.create_server(("127.0.0.1", 0))) as listener,
        http_server(create_app(lab.coordinator, TOKEN), listener, stop),
        closing(lab.coordinator),
    ):
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"


@pytest.fixture
def client(url: str) -> Iterator[Client]:
    with Client(url, TOKEN, timeout=10.0) as client:
        yield client


def teach(lab: Lab, client: Client) -> None:
    """A coarse grasp task, recorded by the client itself."""
    client.add_background("blue cup")
    client.add_example("blue cup")
    for row in (200.0, 240.0, 280.0):
        for column in (280.0, 320.0, 360.0):
            lab.world.cup = np.array([row, column, 150.0])
            shown = client.begin_demonstration("grasp", "blue cup").id
            start = lab.robot.description.park
            for share in (0.0, 0.4, 0.8, 1.0):
                lab.world.joints = start + share * (lab.world.goal_joints() - start)
                client.observe(shown, "grasp", goal=share == 1.0, key=share == 0.0)
            client.mark_action(shown, "grasp", "close_gripper")
            client.finish_demonstration(shown)
    lab.world.joints = lab.robot.description.park.copy()
    lab.world.cup = np.array([230.0, 340.0, 150.0])


def test_teach_train_run_and_read_back_why(lab: Lab, client: Client) -> None:
    client.wait_ready(5.0)
    teach(lab, client)
    assert client.objects()[0].learned
    assert {demonstration.state for demonstration in client.demonstrations()} == {"finished"}
    statistics = client.train("grasp", pairs="all", approximator="local_linear")
    assert (statistics.pairs, len(statistics.demonstrations)) == (36, 9)

    events: list[JobEvent] = []
    job = client.run_task("grasp", "blue cup", timeout=30.0, on_event=events.append).raise_for_failure()
    assert [event.number for event in events] == list(range(1, len(events) + 1))
    assert [event.kind for event in events][0::-1] == ["state"]
    assert events[-1].data["state"] == "succeeded"
    (grasp,) = job.result.subtasks
    assert grasp.action == "close_gripper"
    assert grasp.looks[0].neighbours[0].demonstration.startswith("grasp-")
    assert client.picture(grasp.looks[0].picture)[:2] == b"\xff\xd8"
    assert client.frame("observer")[:2] == b"\xff\xd8"
    assert client.robot().gripper_opening == pytest.approx(0.065)


def test_a_failed_task_says_why_and_the_arm_is_stopped(lab: Lab, client: Client) -> None:
    lab.teach(lab.places)
    client.train("grasp")
    lab.world.hidden.add("hand")
    job = client.run_task("grasp", "blue cup", timeout=30.0)
    with pytest.raises(JobFailed, match=r"failed in subtask 'grasp': hand 'blue cup' is not seen") as failure:
        job.raise_for_failure()
    assert failure.value.job.error is not None
    assert client.robot().stopped
    assert not client.reset_robot().stopped


def test_a_deadline_cancels_the_job(lab: Lab, client: Client) -> None:
    lab.teach(lab.places)
    client.train("grasp")
    lab.robot.hang = True
    with pytest.raises(TimedOut, match="did not end within 1 s"):
        client.run_task("grasp", "blue cup", timeout=1.0)
    (job,) = [lab.coordinator.jobs.get(name) for name in list(lab.coordinator.jobs._jobs)]
    assert job.wait(5.0)
    assert client.job(job.id).state == "cancelled"
    assert client.stop_robot("again").stopped


def test_an_error_in_the_listener_cancels_the_job(lab: Lab, client: Client) -> None:
    lab.teach(lab.places)
    client.train("grasp")
    lab.robot.hang = True

    def listener(event: JobEvent) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        client.run_task("grasp", "blue cup", timeout=30.0, on_event=listener)
    (name,) = list(lab.coordinator.jobs._jobs)
    assert lab.coordinator.jobs.get(name).wait(5.0)
    assert client.job(name).state == "cancelled"


def test_the_servers_end_ends_the_job_and_its_event_stream(lab: Lab, client: Client) -> None:
    lab.teach(lab.places)
    client.train("grasp")
    lab.robot.hang = True
    lab.robot.on_step = threading.Event()
    job = client.start_run("grasp", "blue cup")
    stream = client.events(job.id)
    assert next(stream).kind == "state"
    assert lab.robot.on_step.wait(5.0)
    lab.coordinator.close()
    assert [event.data["state"] for event in stream if event.kind == "state"] == ["cancelled"]


def test_refusals_keep_the_servers_sentence(client: Client, url: str) -> None:
    with pytest.raises(ApiError, match="not trained") as refusal:
        client.start_run("pour", "blue cup")
    assert (refusal.value.status, refusal.value.code, refusal.value.title) == (404, "not_found", "Not Found")
    with Client(url, "another") as stranger, pytest.raises(ApiError, match="not the coordinator's") as refusal:
        stranger.robot()
    assert refusal.value.status == 401
    with pytest.raises(ApiError, match="There is no job"):
        list(client.events("none"))


def test_not_ready_names_what_is_missing(lab: Lab, client: Client) -> None:
    lab.missing.append("nobody serves Camera on the bus")
    assert "Camera" in (client.not_ready() or "")
    with pytest.raises(TimedOut, match="Camera"):
        client.wait_ready(0.2)


def test_nobody_at_the_address() -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
    with Client(f"http://127.0.0.1:{port}", TOKEN) as client, pytest.raises(Unreachable, match=f"{port}.*running"):
        client.robot()
