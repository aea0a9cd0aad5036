"""Tokens, backup and restore, and what else has no module of its own."""

from __future__ import annotations

import json
from pathlib import Path

import httpx2
import pytest

from handeye.client import ApiError
from tests.client.conftest import ROBOT, Connect, Script, problem
from tests.client.test_calls import DEMONSTRATION

TOKEN = {"id": "t1", "name": "lab", "role": "viewer", "created": "2026-11-01T10:00:00Z", "expires": None}


def test_tokens(connect: Connect) -> None:
    coordinator = Script(
        httpx2.Response(201, json={**TOKEN, "token": "shown-once"}),
        httpx2.Response(200, json={"tokens": [TOKEN]}),
        httpx2.Response(204),
    )
    with connect(coordinator) as client:
        assert client.create_token("lab", "viewer", days=30).token == "shown-once"
        assert client.tokens()[0].expires is None
        client.revoke_token("t1")
    assert json.loads(coordinator.asked[0].content) == {"name": "lab", "role": "viewer", "days": 30}
    assert (coordinator.asked[2].method, coordinator.asked[2].url.path) == ("DELETE", "/v1/tokens/t1")


def test_the_store_goes_into_a_file_and_comes_from_one(connect: Connect, tmp_path: Path) -> None:
    file, content = tmp_path / "store.db", b"SQLite format 3\0" + bytes(3 * 2**20)
    with connect(Script(httpx2.Response(200, content=content))) as client:
        client.backup(file)
    assert file.read_bytes() == content
    coordinator = Script(httpx2.Response(200, json={"modules": 1, "samples": 3}))
    with connect(coordinator) as client:
        assert client.restore(file).samples == 3
    (request,) = coordinator.asked
    assert request.content == content
    assert request.headers["content-type"] == "application/vnd.sqlite3"


def test_a_restore_is_not_repeated(connect: Connect, tmp_path: Path) -> None:
    file = tmp_path / "store.db"
    file.write_bytes(b"nonsense")
    coordinator = Script(problem(503, "unavailable", "Not now."))
    with connect(coordinator) as client, pytest.raises(ApiError, match="Not now"):
        client.restore(file)
    assert len(coordinator.asked) == 1


def test_demonstrations_are_labelled_read_and_deleted(connect: Connect) -> None:
    seen = {
        "number": 0,
        "subtask": "grasp",
        "goal": True,
        "key": False,
        "towards": "cup",
        "seconds": 0.0,
        "world_time": 1.0,
        "object": [1.0, 2.0, 3.0],
        "hand": [1.0, 2.0, 3.0],
        "joints": [0.0] * 6,
    }
    coordinator = Script(
        httpx2.Response(200, json={**DEMONSTRATION, "outcome": "failure"}),
        httpx2.Response(200, json={"observations": [seen], "actions": []}),
        httpx2.Response(204),
    )
    with connect(coordinator) as client:
        assert client.label_demonstration("grasp-1", "failure").outcome == "failure"
        assert client.observations("grasp-1")[0].goal
        client.delete_demonstration("grasp-1")
    assert [(request.method, request.url.path) for request in coordinator.asked] == [
        ("PATCH", "/v1/demonstrations/grasp-1"),
        ("GET", "/v1/demonstrations/grasp-1/observations"),
        ("DELETE", "/v1/demonstrations/grasp-1"),
    ]


def test_tasks_and_objects(connect: Connect) -> None:
    task = {"name": "grasp", "module": "IJS.grasp", "subtasks": [{"name": "grasp", "action": "close_gripper"}]}
    task["demonstrations"] = ["grasp-1"]
    coordinator = Script(httpx2.Response(200, json={"tasks": [task]}), httpx2.Response(200, json=task))
    with connect(coordinator) as client:
        assert client.tasks()[0].subtasks[0].action == "close_gripper"
        assert client.task("grasp").demonstrations == ("grasp-1",)
    coordinator = Script(httpx2.Response(204))
    with connect(coordinator) as client:
        client.delete_task("grasp")
        client.delete_object("cup")
    assert [request.url.path for request in coordinator.asked] == ["/v1/tasks/grasp", "/v1/objects/cup"]


def test_the_robot_and_the_head(connect: Connect) -> None:
    head = {"pan": 0.1, "tilt": 0.0, "moving": False, "world_time": 1.0}
    head |= {"pan_lower": -2.7, "pan_upper": 2.7, "tilt_lower": -0.8, "tilt_upper": 0.5, "step": 0.001, "speed": 1.0}
    description = {
        "joint_names": ["waist"],
        "lower": [-1.0],
        "upper": [1.0],
        "speed": [1.0],
        "acceleration": [1.0],
        "park": [0.0],
        "gripper_range": 0.09,
        "clock": "lockstep",
    }
    coordinator = Script(*(httpx2.Response(200, json=each) for each in (ROBOT, head, description)))
    with connect(coordinator) as client:
        robot = client.robot()
        assert (robot.still_since, robot.point) == (0.0, (0.35, 0.0, 0.2))
        assert client.head().pan_upper == 2.7
        assert client.robot_description().park == (0.0,)


def test_whether_it_is_ready(connect: Connect) -> None:
    missing = problem(503, "not_ready", "Not ready: nobody serves Camera.")
    coordinator = Script(missing, missing, httpx2.ConnectError("refused"), httpx2.Response(200, json={"status": "ok"}))
    with connect(coordinator) as client:
        assert client.not_ready() == "Not ready: nobody serves Camera."
        client.wait_ready(5.0)
        assert client.not_ready() is None
