"""The client's commands that run tasks, tell of jobs, and administer."""

from __future__ import annotations

import io
import json
import re
import signal
from pathlib import Path

import httpx2
import numpy as np
import pytest
from typer.testing import Result

from handeye.client import ApiError
from handeye.client.verbs_common import signals_unwind
from tests.client.conftest import ROBOT, Run, Script, event, job, said, streamed
from tests.client.test_admin import TOKEN

# Runs, stop and reset

LOOK: dict[str, object] = {"number": 0, "delta": [0.1, -0.25], "support": 0.9}


def run_task(run: Run, ended: dict[str, object]) -> Result:
    stream = (event(1, "subtask", {"name": "grasp", "state": "running"}), event(2, "look", LOOK))

    def answer(request: httpx2.Request) -> httpx2.Response:
        if request.method == "POST":
            assert json.loads(request.content) == {"object": "cup", "one_look": True, "least_support": None}
            return httpx2.Response(202, json=job("running"))
        if request.url.path.endswith("/events"):
            return streamed(*stream, event(3, "state", ended))
        return httpx2.Response(200, json=ended)

    return run(answer, "run", "grasp", "--object", "cup", "--one-look")


def test_a_run_shows_the_looks_and_succeeds(run: Run) -> None:
    result = run_task(run, job("succeeded"))
    assert result.exit_code == 0
    assert "look 0: largest answer 0.2500 rad, support 0.90" in result.output
    assert "Task 'grasp' with 'cup' succeeded" in result.output
    assert "handeye job show j1" in result.output


def test_a_run_fails_with_the_jobs_reason(run: Run) -> None:
    result = run_task(run, job("failed", error={"code": "stopped", "message": "the robot is stopped"}))
    assert result.exit_code != 0
    assert "the robot is stopped" in said(result)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_cancels_the_job_of_the_command(run: Run, number: signal.Signals) -> None:
    asked: list[str] = []

    def answer(request: httpx2.Request) -> httpx2.Response:
        asked.append(request.url.path)
        if request.url.path.endswith("/events"):
            signal.raise_signal(number)
        return httpx2.Response(202, json=job("running"))

    before = signal.signal(number, signal.SIG_DFL)  # who runs the tests may ignore HUP
    try:
        result = run(answer, "run", "grasp", "--object", "cup")
        assert signal.getsignal(number) is signal.SIG_DFL
    finally:
        signal.signal(number, before)
    assert result.exit_code == 128 + number
    assert asked == ["/v1/tasks/grasp/runs", "/v1/jobs/j1/events", "/v1/jobs/j1/cancel"]


def test_an_ignored_hup_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with signals_unwind():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize(
    ("arguments", "path", "body"),
    [
        (["stop"], "/v1/robot/stop", {"reason": "a person asked for it"}),
        (["stop", "--reason", "a cat"], "/v1/robot/stop", {"reason": "a cat"}),
        (["reset"], "/v1/robot/reset", None),
    ],
)
def test_the_robot_is_stopped_and_reset(run: Run, arguments: list[str], path: str, body: dict[str, str] | None) -> None:
    coordinator = Script(httpx2.Response(200, json=ROBOT))
    assert run(coordinator, *arguments).exit_code == 0
    (request,) = coordinator.asked
    assert (request.url.path, json.loads(request.content) if request.content else None) == (path, body)


def test_a_stop_that_cannot_be_done_fails(run: Run) -> None:
    assert isinstance(run(Script(httpx2.Response(503)), "stop").exception, ApiError)


# Jobs

RUN = {
    "subtasks": [
        {
            "name": "grasp",
            "state": "succeeded",
            "started": 0.0,
            "ended": 2.0,
            "aligned": True,
            "action": "close_gripper",
            "looks": [
                {
                    "number": 0,
                    "world_time": 1.5,
                    "object": [200.0, 300.0, 40.0],
                    "hand": [100.0, 300.0, 40.0],
                    "hand_seen": True,
                    "delta": [0.1, -0.25],
                    "support": 0.87,
                    "neighbours": [
                        {"sample": 7, "demonstration": "grasp-2", "distance": 0.1, "weight": 0.5},
                        {"sample": 8, "demonstration": "grasp-1", "distance": 0.2, "weight": 0.1},
                        {"sample": 9, "demonstration": "grasp-2", "distance": 0.3, "weight": 0.2},
                        {"sample": 3, "demonstration": None, "distance": 0.3, "weight": 0.05},
                    ],
                    "moved": [0.1, -0.25],
                    "picture": "/v1/jobs/j1/looks/0.jpg",
                }
            ],
        }
    ]
}


def test_a_run_tells_why_each_motion_was_made(run: Run) -> None:
    ended = job("succeeded", result=RUN)
    words = said(run(Script(httpx2.Response(200, json=ended)), "job", "show", "j1"))
    assert "Task 'grasp' with 'cup': succeeded" in words
    assert "grasp: succeeded, then close_gripper" in words
    assert re.search(r"grasp-2 \(70%\).*grasp-1 \(10%\).*sample 3 \(5%\)", words)
    assert "answer 0.1000 -0.2500" in words
    assert "0.87" in words


def test_other_jobs_tell_what_they_reached(run: Run) -> None:
    failed = job("interrupted", "motion", {"code": "interrupted", "message": "The coordinator ended."}, result=ROBOT)
    words = said(run(Script(httpx2.Response(200, json=failed)), "job", "show", "j1"))
    assert "Motion 'grasp': interrupted, The coordinator ended." in words
    assert "gripper_opening" in words


def test_jobs_are_listed_and_cancelled(run: Run) -> None:
    page = {"jobs": [job("running", progress=0.25), job("failed", "train", {"code": "x", "message": "why"})]}
    words = said(run(Script(httpx2.Response(200, json={**page, "next": None})), "job", "list"))
    assert "running, 25%" in words
    assert "why" in words
    coordinator = Script(httpx2.Response(202, json=job("running")))
    assert run(coordinator, "job", "cancel", "j1").output == "Job j1 is asked to end; it was running.\n"
    assert coordinator.asked[0].url.path == "/v1/jobs/j1/cancel"


# Administration


def test_a_new_token_stands_alone_on_stdout(run: Run) -> None:
    coordinator = Script(httpx2.Response(201, json={**TOKEN, "token": "shown-once"}))
    result = run(coordinator, "token", "create", "lab", "--role", "viewer", "--days", "30")
    assert result.stdout == "shown-once\n"
    assert "only this once" in result.stderr


def test_tokens_are_listed_and_revoked(run: Run) -> None:
    words = said(run(Script(httpx2.Response(200, json={"tokens": [TOKEN]})), "token", "list"))
    assert "lab" in words
    assert "never" in words
    coordinator = Script(httpx2.Response(204))
    assert run(coordinator, "token", "revoke", "t1").exit_code == 0
    assert coordinator.asked[0].url.path == "/v1/tokens/t1"


def test_a_backup_overwrites_nothing(run: Run, tmp_path: Path) -> None:
    file, coordinator = tmp_path / "b.db", Script(httpx2.Response(200, content=b"SQLite"))
    assert "MiB" in said(run(coordinator, "backup", str(file)))
    assert file.read_bytes() == b"SQLite"
    assert "overwrites nothing" in said(run(coordinator, "backup", str(file)))
    assert len(coordinator.asked) == 1


def test_a_restore_is_done_when_it_is_meant(run: Run, tmp_path: Path) -> None:
    file, coordinator = tmp_path / "b.db", Script(httpx2.Response(200, json={"modules": 2, "samples": 3}))
    file.write_bytes(b"SQLite")
    assert run(coordinator, "restore", str(file), text="n\n").exit_code == 1
    assert not coordinator.asked
    assert "2 modules with 3 samples" in said(run(coordinator, "restore", str(file), "--yes"))
    assert coordinator.asked[0].content == b"SQLite"


def test_exported_files_are_what_numpy_reads(run: Run, tmp_path: Path) -> None:
    content = io.BytesIO()
    np.savez(content, inputs=np.ones((2, 1)))
    file = tmp_path / "m.npz"
    run(Script(httpx2.Response(200, content=content.getvalue())), "module", "export", "m", str(file))
    with np.load(file, allow_pickle=False) as arrays:
        assert arrays["inputs"].shape == (2, 1)
