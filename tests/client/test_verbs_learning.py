"""The client's commands for modules, training and queries."""

from __future__ import annotations

import json
from pathlib import Path

import httpx2
import pytest

from handeye.client import WrongArrays
from tests.client.conftest import Handler, Run, Script, event, job, problem, said, streamed
from tests.client.test_calls import DEMONSTRATION
from tests.client.test_modules import INFO, STATISTICS, Memory

# Modules


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("m.json", '{"name": "m", "inputs": [{"name": "x"}], "outputs": [{"name": "y"}]}'),
        ("m.toml", 'name = "m"\n[[inputs]]\nname = "x"\n[[outputs]]\nname = "y"\n'),
    ],
)
def test_a_module_is_made_from_a_file(run: Run, tmp_path: Path, name: str, text: str) -> None:
    file = tmp_path / name
    file.write_text(text)
    coordinator = Script(httpx2.Response(201, json=INFO))
    assert run(coordinator, "module", "create", str(file)).exit_code == 0
    assert json.loads(coordinator.asked[0].content) == {
        "name": "m",
        "inputs": [{"name": "x"}],
        "outputs": [{"name": "y"}],
    }


@pytest.mark.parametrize(("name", "text"), [("m.json", "{"), ("m.toml", "= 1"), ("m.json", "[]")])
def test_a_file_that_declares_nothing_is_named(run: Run, tmp_path: Path, name: str, text: str) -> None:
    file = tmp_path / name
    file.write_text(text)
    result = run(Script(httpx2.Response(500)), "module", "create", str(file))
    assert isinstance(result.exception, WrongArrays)
    assert name in str(result.exception)


def test_modules_are_listed_and_shown(run: Run) -> None:
    listed = run(Script(httpx2.Response(200, json={"modules": [INFO], "next": None})), "module", "list")
    assert "reach/near" in listed.output
    nothing = run(Script(httpx2.Response(200, json={"modules": [], "next": None})), "module", "list")
    assert nothing.output == "Modules: none\n"

    kept = {"name": "[bold]before", "created": "2026-11-01T10:00:00Z", "samples": 3}

    def answer(request: httpx2.Request) -> httpx2.Response:
        last = request.url.path.rsplit("/", 1)[1]
        content = {"statistics": STATISTICS, "snapshots": {"snapshots": [kept]}}.get(last, INFO)
        return httpx2.Response(200, json=content)

    shown = said(run(answer, "module", "show", "reach/near"))
    assert all(word in shown for word in ("turn", "rad", "kndb", "[bold]before", "3 samples of 1 demonstrations"))


def test_samples_are_added_from_a_file(run: Run, tmp_path: Path) -> None:
    file, memory = tmp_path / "s.csv", Memory()
    file.write_text("x,turn\n1,2\n3,4\n")

    def answer(request: httpx2.Request) -> httpx2.Response:
        return memory(request) if request.method == "POST" else httpx2.Response(200, json=INFO)

    result = run(answer, "module", "add", "reach/near", str(file), "--demonstration", "d")
    assert result.output == "Module 'reach/near' has 2 samples more, 0 to 1.\n"
    assert memory.batches[0]["inputs"].tolist() == [[1.0], [3.0]]
    assert memory.batches[0]["demonstrations"].tolist() == ["d", "d"]


def test_samples_are_shown_and_forgotten(run: Run) -> None:
    page = [{"number": i, "input": [0.125], "output": [2.0], "demonstration": "grasp-1"} for i in range(30)]

    def answer(request: httpx2.Request) -> httpx2.Response:
        content = {"samples": page, "next": None} if request.url.path.endswith("/samples") else INFO
        return httpx2.Response(200, json=content)

    shown = run(answer, "module", "samples", "reach/near", "--limit", "2")
    assert shown.output.count("grasp-1") == 2
    assert "0.125" in shown.output
    coordinator = Script(httpx2.Response(200, json={"removed": 2}))
    forgotten = run(coordinator, "module", "forget", "m", "--sample", "7", "--sample", "8")
    assert forgotten.output == "Module 'm' has 2 samples fewer.\n"
    assert coordinator.asked[0].url.query == b"number=7&number=8"
    assert run(coordinator, "module", "forget", "m").exit_code == 2


def test_a_module_is_deleted_when_it_is_meant(run: Run) -> None:
    coordinator = Script(httpx2.Response(204))
    assert run(coordinator, "module", "delete", "m", text="n\n").exit_code == 1
    assert run(coordinator, "module", "delete", "m").exit_code == 1
    assert not coordinator.asked
    assert run(coordinator, "module", "delete", "m", text="y\n").exit_code == 0
    assert run(coordinator, "module", "delete", "m", "--yes").exit_code == 0
    assert len(coordinator.asked) == 2


def test_snapshots_are_taken_returned_to_and_forgotten(run: Run) -> None:
    kept = {"name": "before", "created": "2026-11-01T10:00:00Z", "samples": 3}
    taken = run(Script(httpx2.Response(201, json=kept)), "module", "snapshot", "m", "before")
    assert taken.output == "Snapshot 'before' has 3 samples of module 'm'.\n"
    coordinator = Script(httpx2.Response(200, json=INFO))
    assert "3 samples" in run(coordinator, "module", "rollback", "m", "before").output
    coordinator = Script(httpx2.Response(204))
    assert run(coordinator, "module", "snapshot", "m", "before", "--delete").exit_code == 0
    assert coordinator.asked[0].method == "DELETE"


def test_modules_go_into_files_and_back(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "m.npz"
    assert run(Script(httpx2.Response(200, content=b"PK")), "module", "export", "m", str(file)).exit_code == 0
    coordinator = Script(httpx2.Response(201, json=INFO))
    result = run(coordinator, "module", "import", str(file), "--name", "copy")
    assert result.output == "Module 'reach/near' is there with 3 samples.\n"
    assert coordinator.asked[0].url.query == b"name=copy"


# Training and queries


def training(ended: dict[str, object], asked: list[str], *, module: bool = False, shown: str = "grasp") -> Handler:
    """A coordinator that was shown a task and may have a module of the name that is asked for."""

    def answer(request: httpx2.Request) -> httpx2.Response:
        path = request.url.path
        if request.method == "POST":
            asked.append(path)
            return httpx2.Response(202, json=job("queued", "train"))
        if path.startswith("/v1/modules/"):
            return httpx2.Response(200, json=INFO) if module else problem(404, "not_found", "There is no module.")
        if path == "/v1/tasks":
            return httpx2.Response(200, json={"tasks": []})
        if path == "/v1/demonstrations":
            return httpx2.Response(200, json={"demonstrations": [{**DEMONSTRATION, "task": shown}], "next": None})
        if path.endswith("/events"):
            return streamed(event(1, "progress", {"progress": 0.5}), event(2, "state", ended))
        return httpx2.Response(200, json=ended)

    return answer


def test_a_task_is_trained(run: Run) -> None:
    subtask = {"name": "grasp", "action": "close_gripper", "pairs": 20, "nodes": 15, "levels": 3}
    result = {"task": "grasp", "module": "IJS.grasp", "demonstrations": ["a", "b"], "pairs": 20}
    ended = job("succeeded", "train", result={**result, "subtasks": [subtask], "approximator": {}, "frame": "picture"})
    asked: list[str] = []
    for module in (False, True):
        words = said(run(training(ended, asked, module=module), "train", "grasp", "--key-pairs"))
        assert "Task 'grasp', from 2 demonstrations" in words
        assert "close_gripper" in words
    run(training(ended, asked, module=True), "train", "grasp")
    assert asked == ["/v1/tasks/grasp/train"] * 3


def test_a_module_is_trained_where_there_is_no_task(run: Run) -> None:
    asked: list[str] = []
    ended = job("succeeded", "train", result=STATISTICS)
    result = run(training(ended, asked, module=True), "train", "m", "--approximator", "kndb")
    assert "Module 'm'" in result.output
    assert asked == ["/v1/modules/m/train"]


def test_a_training_that_fails_says_why(run: Run) -> None:
    failed = job("failed", "train", {"code": "not_teachable", "message": "they disagree"})
    assert "they disagree" in said(run(training(failed, []), "train", "grasp"))


def asking(memory: Memory) -> Handler:
    return lambda request: memory(request) if request.method == "POST" else httpx2.Response(200, json=INFO)


def test_one_query_is_answered_with_its_reasons(run: Run) -> None:
    result = run(asking(Memory()), "query", "reach/near", "-1.5")
    assert result.exit_code == 0
    words = said(result)
    assert "turn -3 – rad" in words
    assert "support 1.00" in words
    assert all(word in words for word in ("first", "second", "0.333333"))


def test_many_queries_are_answered_as_csv(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "q.csv"
    file.write_text("x\n1.5\n-2\n")
    result = run(asking(Memory()), "query", "reach/near", "--file", str(file))
    assert result.output == "turn,expected error of turn,support\n3.0,inf,1.0\n-4.0,inf,1.0\n"


def test_a_query_of_another_length_names_the_inputs(run: Run) -> None:
    result = run(asking(Memory()), "query", "reach/near", "1", "2")
    assert str(result.exception) == "module 'reach/near' has 1 inputs: x"
    assert run(asking(Memory()), "query", "reach/near").exit_code == 2
