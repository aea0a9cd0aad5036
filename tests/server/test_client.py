"""The Python client against the real application, over a real connection: synchronous and asynchronous."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from handeye.client import (
    ApiError,
    AsyncClient,
    Client,
    Control,
    JobFailed,
    LeaseLost,
    TimedOut,
    Unreachable,
    WrongArrays,
)
from handeye.server.serve import http_server
from tests.client.blocking import Blocking
from tests.server.conftest import TOKEN

if TYPE_CHECKING:
    from handeye.client.models import JobEvent, RunJob
    from tests.server.conftest import Lab

TIMEOUT = 10.0


@pytest.fixture(autouse=True)
def own_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Backups are made in a folder of the test's."""
    monkeypatch.setenv("HANDEYE_SERVER_DATA_DIR", str(tmp_path / "data"))


@pytest.fixture
def url(lab: Lab) -> Iterator[str]:
    stop = threading.Event()
    with (
        closing(socket.create_server(("127.0.0.1", 0))) as listener,
        http_server(lab.app(), listener, stop),
        closing(lab.coordinator),
    ):
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"


@pytest.fixture(params=["sync", "async"])
def client(request: pytest.FixtureRequest, url: str) -> Iterator[Client]:
    if request.param == "sync":
        with Client(url, TOKEN, TIMEOUT) as client:
            yield client
        return
    with asyncio.Runner() as runner, Blocking(AsyncClient(url, TOKEN, TIMEOUT), runner) as client:
        yield cast("Client", client)


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


# Modules

DECLARATION: dict[str, Any] = {
    "name": "plane",
    "inputs": [{"name": "x", "unit": "m"}, {"name": "y", "unit": "m"}],
    "outputs": [{"name": "sum", "unit": "m"}, {"name": "difference", "unit": "m"}],
}


def taught(client: Client, count: int = 400) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Module 'plane' with `count` samples of two demonstrations; returns its inputs."""
    client.create_module(DECLARATION)
    inputs = np.random.default_rng(3).uniform(-1.0, 1.0, (count, 2))
    outputs = np.column_stack([inputs.sum(axis=1), inputs[:, 0] - inputs[:, 1]])
    numbers = client.add_samples("plane", inputs, outputs, [f"hand-{i % 2}" for i in range(count)])
    assert np.array_equal(numbers, np.arange(count))
    return inputs


def test_a_module_learns_answers_and_forgets(client: Client) -> None:
    inputs = taught(client)
    info = client.module("plane")
    assert (info.samples, info.demonstrations) == (400, 2)
    assert [module.name for module in client.modules()] == ["plane"]

    answers = client.query("plane", inputs[:50], neighbours=3)
    assert np.allclose(answers.outputs[:, 0], inputs[:50].sum(axis=1), atol=1e-3)
    assert answers.samples[:, 0].tolist() == list(range(50))
    assert answers.distances[:, 0].tolist() == [0.0] * 50
    assert answers.demonstrations[:, 0].tolist() == [f"hand-{i % 2}" for i in range(50)]
    assert (answers.support > 0.5).all()
    assert client.query("plane", [9.0, 9.0]).support[0] < 0.2
    assert client.query("plane", [0.0, 0.0], neighbours=0).samples.shape == (1, 0)

    assert client.remove_samples("plane", demonstration="hand-1") == 200
    assert client.remove_samples("plane", [0, 2, 4]) == 3
    assert client.query("plane", inputs[:1], neighbours=1).samples[0, 0] not in (0, 1)
    left = list(client.samples("plane"))
    assert [sample.number for sample in left] == list(range(6, 400, 2))
    assert left[0].demonstration == "hand-0"
    assert left[0].input == tuple(inputs[6])


def test_large_batches_go_and_come_whole(client: Client) -> None:
    client.create_module(DECLARATION)
    inputs = np.random.default_rng(4).uniform(-1.0, 1.0, (12_345, 2))
    numbers = client.add_samples("plane", inputs, -inputs)
    assert np.array_equal(numbers, np.arange(12_345))
    answers = client.query("plane", inputs, neighbours=1)
    assert np.array_equal(answers.samples[:, 0], numbers)
    assert set(answers.demonstrations[:, 0]) == {""}


def test_a_module_is_looked_into_and_trained_anew(client: Client) -> None:
    taught(client)
    statistics = client.statistics("plane")
    assert statistics.categories[0].samples == 400
    tree = client.tree("plane")
    assert tree.components == ("x", "y")
    assert tree.nodes[0].parent is None
    events: list[JobEvent] = []
    trained = client.train_module("plane", {"method": "nearest"}, timeout=30.0, on_event=events.append)
    assert trained.categories[0].samples == 400
    assert events[-1].data["state"] == "succeeded"
    approximator = client.module("plane").declaration.approximator
    assert approximator is not None
    assert approximator["method"] == "nearest"


def test_a_module_returns_to_what_it_was(client: Client) -> None:
    taught(client)
    assert client.take_snapshot("plane", "before").samples == 400
    client.remove_samples("plane", demonstration="hand-0")
    assert client.roll_back("plane", "before").samples == 400
    assert [each.name for each in client.snapshots("plane")] == ["before"]
    client.delete_snapshot("plane", "before")
    assert client.snapshots("plane") == ()


def test_a_module_goes_through_a_file(client: Client, tmp_path: Path) -> None:
    inputs = taught(client)
    client.export_module("plane", tmp_path / "plane.npz")
    with np.load(tmp_path / "plane.npz", allow_pickle=False) as arrays:
        assert np.array_equal(arrays["inputs"], inputs)
    assert client.import_module(tmp_path / "plane.npz", "copy").samples == 400
    assert np.array_equal(client.query("copy", inputs[:9]).outputs, client.query("plane", inputs[:9]).outputs)
    client.delete_module("plane")
    assert [module.name for module in client.modules()] == ["copy"]


def test_all_of_it_goes_through_a_file(client: Client, tmp_path: Path) -> None:
    inputs = taught(client)
    before = client.query("plane", inputs[:9])
    client.backup(tmp_path / "all.db")
    assert (tmp_path / "all.db").read_bytes().startswith(b"SQLite format 3\0")
    client.delete_module("plane")
    restored = client.restore(tmp_path / "all.db")
    assert (restored.modules, restored.samples) == (1, 400)
    assert np.array_equal(client.query("plane", inputs[:9]).outputs, before.outputs)
    (tmp_path / "other.db").write_bytes(b"this is no store")
    with pytest.raises(ApiError, match="cannot be restored"):
        client.restore(tmp_path / "other.db")


def test_what_does_not_fit_is_refused_with_a_sentence(client: Client) -> None:
    taught(client)
    with pytest.raises(ApiError, match="already") as refused:
        client.create_module(DECLARATION)
    assert refused.value.status == 409
    with pytest.raises(ApiError, match="3") as refused:
        client.add_samples("plane", np.zeros((1, 3)), np.zeros((1, 2)))
    assert refused.value.status == 422
    with pytest.raises(ApiError, match="no module 'sphere'"):
        client.query("sphere", [1.0])
    client.remove_samples("plane", range(400))
    with pytest.raises(ApiError) as refused:
        client.query("plane", [0.0, 0.0])
    assert (refused.value.status, refused.value.code) == (409, "not_taught")


# Robot, head and cameras


def test_the_arm_moves_under_the_lease(lab: Lab, client: Client) -> None:
    with client.control("alice") as arm:
        assert arm.move_to_joints([0.1] * 6, speed=0.2).joints == pytest.approx([0.1] * 6)
        assert arm.adjust_joints([0.1] * 6).joints == pytest.approx([0.2] * 6)
        assert arm.close_gripper().gripper_opening == pytest.approx(0.065)
        assert arm.open_gripper().gripper_opening == pytest.approx(0.09)
        arm.move_to_point((0.5, 0.0, 0.3))
        before = arm.state().world_time
        assert arm.advance(0.5).world_time == pytest.approx(before + 0.5)
        assert arm.park(0.3, 0.3).joints == pytest.approx(lab.robot.description.park)
        assert arm.turn_head(0.2, -0.1).pan == pytest.approx(0.2)
        with pytest.raises(ApiError, match="alice"), client.control("bob"):
            pass
    assert not lab.robot.leased
    assert client.head().tilt == pytest.approx(-0.1)
    assert client.robot_description().park == pytest.approx(lab.robot.description.park)
    assert {job.subject for job in client.jobs()} >= {"park", "head", "move_to_point"}


def test_a_stop_ends_a_motion_and_refuses_the_next(lab: Lab, client: Client) -> None:
    client.stop_robot("a cat")
    with client.control("alice") as arm, pytest.raises(JobFailed, match="a cat"):
        arm.park()
    client.reset_robot()
    with client.control("alice") as arm:
        arm.park()


def test_leaving_a_motion_early_brakes_it(lab: Lab, client: Client) -> None:
    lab.robot.hang = True
    with client.control("alice", motion_timeout=0.5) as arm, pytest.raises(TimedOut):
        arm.park()
    assert client.jobs(limit=1)[0].state == "cancelled"
    assert not lab.robot.leased


def test_control_lasts_as_long_as_there_are_signs_of_life(lab: Lab, url: str) -> None:
    with Client(url, TOKEN) as client, client.control("alice") as arm:
        time.sleep(3.0)
        arm.park()

    async def main() -> None:
        async with AsyncClient(url, TOKEN) as client, client.control("alice") as arm:
            await asyncio.sleep(3.0)
            await arm.park()

    asyncio.run(main())


def test_control_that_is_taken_away_is_noticed(lab: Lab, url: str) -> None:
    def taken_away(arm: Control) -> None:
        lab.coordinator.control.close()
        arm.park()

    with Client(url, TOKEN) as client, pytest.raises(LeaseLost), client.control("alice") as arm:
        taken_away(arm)


def test_pictures_are_files_and_arrays(lab: Lab, client: Client) -> None:
    image = client.image("left")
    assert image.pixels.shape == (48, 64, 3)
    assert image.pixels.dtype == np.uint8
    assert image.world_time == pytest.approx(lab.world.time - lab.cameras.latency)
    assert client.frame_png("right").startswith(b"\x89PNG")
    frames = client.frames("left", rate=30.0)
    assert [next(frames)[:2] for _ in range(3)] == [b"\xff\xd8"] * 3
    cast("Any", frames).close()


# Access and errors


def test_tokens_have_roles(url: str, client: Client) -> None:
    made = client.create_token("guest", "viewer", days=1)
    assert made.id in [token.id for token in client.tokens()]
    with Client(url, made.token) as guest:
        assert guest.stop_robot("a guest saw a cat").stopped
        with pytest.raises(ApiError, match="role operator") as refused:
            guest.reset_robot()
        assert (refused.value.status, refused.value.code) == (403, "forbidden")
    client.revoke_token(made.id)
    with Client(url, made.token) as guest, pytest.raises(ApiError) as refused:
        guest.robot()
    assert refused.value.status == 401


def test_refusals_keep_the_servers_sentence(client: Client, url: str) -> None:
    with pytest.raises(ApiError, match="not trained") as refusal:
        client.start_run("pour", "blue cup")
    assert (refusal.value.status, refusal.value.code, refusal.value.title) == (404, "not_found", "Not Found")
    with Client(url, "another") as stranger, pytest.raises(ApiError, match="Nobody has this token") as refusal:
        stranger.robot()
    assert (refusal.value.status, refusal.value.code) == (401, "token_wrong")
    with pytest.raises(ApiError, match="There is no job"):
        list(client.events("none"))


def test_lists_longer_than_a_page_come_whole(lab: Lab, client: Client) -> None:
    lab.coordinator.show_object("blue cup", "backgrounds", 0.0)
    lab.coordinator.show_object("blue cup", "examples", 0.0)
    for _ in range(150):
        lab.coordinator.demonstrations.begin("grasp", "blue cup")
    assert [shown.id for shown in client.demonstrations()] == [f"grasp-{n}" for n in range(1, 151)]


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


def test_collects_gazes_follows_and_reaches(lab: Lab, client: Client) -> None:
    client.add_background("blue cup")
    client.add_example("blue cup")
    for row, column, tilt in np.random.default_rng(2).uniform((120, 260, -0.1), (260, 420, 0.1), (8, 3)):
        lab.world.cup, lab.world.head = np.array([row, column, 150.0]), (0.0, tilt)
        collected = client.collect_fixation("blue cup").raise_for_failure().result
        assert collected is not None
        assert collected.added["SCS"] > 3
    lab.world.cup, lab.world.head = np.array([200.0, 300.0, 150.0]), (0.0, 0.0)
    seen = client.look("blue cup")
    assert seen.point == (200.0, 300.0, 150.0)
    gaze = client.gaze("blue cup").raise_for_failure().result
    assert gaze is not None
    assert gaze.looks[0].offset > 300.0 > 3.0 > gaze.looks[-1].offset
    job = client.pursue("blue cup", 0.5).raise_for_failure()
    assert job.result is not None
    assert (job.kind, job.result.duration) == ("pursuit", 0.5)
    assert 6 <= len(job.result.looks) <= 7  # every tenth of a second of the toy's time, but for how sums are rounded
    assert job.result.looks[-1].offset == pytest.approx(gaze.looks[-1].offset, abs=1.0)
    assert client.job(job.id) == job
    events: list[JobEvent] = []
    babbled = client.collect_postures(
        ["AJS"],
        postures=12,
        lower=(0.5, -0.3, 0.2),
        upper=(0.8, 0.0, 0.44),
        synergies=np.eye(6)[:3].tolist(),
        on_event=events.append,
    )
    assert babbled.raise_for_failure().subject == "AJS"
    assert [event.data["posture"] for event in events if event.kind == "posture"] == list(range(1, 13))
    failed = client.reach((200.0, 300.0, 150.0))
    assert failed.error is not None
    assert failed.error.code == "not_taught"
    with pytest.raises(ApiError, match="grid is not seen"):
        client.collect_grid_view(np.zeros((4, 5, 3)))
    with pytest.raises(WrongArrays, match="rows, columns, 3"):
        client.collect_grid_view(np.zeros((4, 5)))
