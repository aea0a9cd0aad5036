"""The Python client against the real application: demonstrations, tasks, jobs and their events."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest

from handeye.client import (
    ApiError,
    Client,
    JobFailed,
    TimedOut,
)
from tests.server.client.conftest import TIMEOUT

if TYPE_CHECKING:
    from handeye.client.models import JobEvent, RunJob
    from tests.server.conftest import Lab


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
    assert (grasp.looks[0].neighbours[0].demonstration or "").startswith("grasp-")
    assert client.picture(grasp.looks[0].picture)[:2] == b"\xff\xd8"
    assert client.frame("observer")[:2] == b"\xff\xd8"
    assert client.robot().gripper_opening == pytest.approx(0.065)

    again = client.job(job.id)
    assert again == job
    assert [each.kind for each in client.jobs()] == ["run", "train"]
    assert client.jobs()[0] == job
    (task,) = client.tasks()
    assert task == client.task("grasp")
    assert (task.module, len(task.demonstrations)) == (statistics.module, 9)
    assert client.module(task.module).samples == 36


def test_an_object_is_marked_by_a_person(lab: Lab, client: Client) -> None:
    client.add_background("blue cup")
    client.add_example("blue cup")
    shown = client.begin_demonstration("grasp", "blue cup").id
    lab.world.hidden.add("object")
    assert client.observe(shown, "grasp", object_at=np.array([230.5, 340.0, 150.0])).object == (230.5, 340.0, 150.0)
    with pytest.raises(ValueError, match="a marked point"):
        client.observe(shown, "grasp", object_at=[np.nan, 0.0, 0.0])


def test_demonstrations_are_judged_and_deleted(lab: Lab, client: Client) -> None:
    teach(lab, client)
    first = client.demonstrations()[0]
    seen = client.observations(first.id)
    assert [each.goal for each in seen] == [False, False, False, True]
    assert client.label_demonstration(first.id, "failure").outcome == "failure"
    statistics = client.train("grasp")
    assert first.id not in statistics.demonstrations
    second = statistics.demonstrations[0]
    client.delete_demonstration(second)
    assert client.module(statistics.module).samples == statistics.pairs - 4
    with pytest.raises(ApiError, match="no demonstration"):
        client.demonstration(second)
    client.delete_task("grasp")
    client.delete_object("blue cup")
    assert client.tasks() == ()
    assert client.objects() == ()


def test_a_failed_task_says_why_and_the_arm_is_stopped(lab: Lab, client: Client) -> None:
    lab.teach(lab.places)
    client.train("grasp")
    lab.world.hidden.add("hand")
    job = client.run_task("grasp", "blue cup", timeout=30.0)
    with pytest.raises(JobFailed, match=r"failed in subtask 'grasp': hand 'marker 7' is not seen") as failure:
        job.raise_for_failure()
    assert failure.value.job.error is not None
    assert client.robot().stopped
    assert not client.reset_robot().stopped


def ended(client: Client) -> RunJob:
    """The newest job, once it has ended."""
    newest = client.jobs(limit=1)[0]
    return cast("RunJob", client.follow(newest.id, TIMEOUT))


def test_a_deadline_cancels_the_job(lab: Lab, client: Client) -> None:
    lab.teach(lab.places)
    client.train("grasp")
    lab.robot.hang = True
    with pytest.raises(TimedOut, match="did not end within 1 s"):
        client.run_task("grasp", "blue cup", timeout=1.0)
    assert ended(client).state == "cancelled"
    assert client.stop_robot("again").stopped


def test_an_error_in_the_listener_cancels_the_job(lab: Lab, client: Client) -> None:
    lab.teach(lab.places)
    client.train("grasp")
    lab.robot.hang = True

    def listener(event: JobEvent) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        client.run_task("grasp", "blue cup", timeout=30.0, on_event=listener)
    assert ended(client).state == "cancelled"


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
