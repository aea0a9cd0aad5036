"""The client's commands against the real application: teach, train, ask, run, say why, replay."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from handeye.client.verbs import register
from tests.server.conftest import TOKEN

if TYPE_CHECKING:
    from tests.server.conftest import Lab

Run = Callable[..., str]


@pytest.fixture
def run(url: str, monkeypatch: pytest.MonkeyPatch) -> Run:
    """What a command says; it must succeed."""
    monkeypatch.setenv("HANDEYE_URL", url)
    monkeypatch.setenv("HANDEYE_TOKEN", TOKEN)
    app = typer.Typer()
    register(app)

    def invoked(*arguments: str, text: str = "") -> str:
        result = CliRunner().invoke(app, [*arguments], input=text)
        if result.exception is not None:
            raise result.exception
        # The application's log goes to the same place: it runs in this process.
        return "\n".join(line for line in result.output.splitlines() if "request_id=" not in line)

    return invoked


def test_a_module_from_its_declaration_to_its_answer(run: Run, tmp_path: Path) -> None:
    declaration, samples, queries = tmp_path / "plane.toml", tmp_path / "samples.csv", tmp_path / "queries.csv"
    declaration.write_text(
        'name = "plane"\n[[inputs]]\nname = "x"\nunit = "m"\n[[inputs]]\nname = "y"\nunit = "m"\n'
        '[[outputs]]\nname = "sum"\nunit = "m"\n'
    )
    inputs = np.random.default_rng(1).uniform(-1.0, 1.0, (200, 2))
    with samples.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["sum", "x", "y", "demonstration"])
        writer.writerows([x + y, x, y, f"hand-{i % 2}"] for i, (x, y) in enumerate(inputs.tolist()))
    queries.write_text("x,y\n0.1,0.2\n-0.3,0.1\n")

    assert "Module 'plane' is there" in run("module", "create", str(declaration))
    assert "200 samples more, 0 to 199" in run("module", "add", "plane", str(samples))
    assert "hand-1" in run("module", "samples", "plane", "--limit", "3")
    answer = run("query", "plane", "-0.3", "0.1", "--neighbours", "2")
    assert re.search(r"sum +-0\.[12]\d+", answer)
    assert "hand-" in answer
    rows = list(csv.DictReader(run("query", "plane", "--file", str(queries)).splitlines()))
    assert [float(row["sum"]) for row in rows] == pytest.approx([0.3, -0.2], abs=0.01)

    assert "200 samples" in run("module", "snapshot", "plane", "all of it")
    assert "100 samples fewer" in run("module", "forget", "plane", "--demonstration", "hand-1")
    assert "with 200 samples" in run("module", "rollback", "plane", "all of it")
    assert "200" in run("train", "plane", "--approximator", "nearest")
    shown = run("module", "show", "plane")
    assert "nearest" in shown
    assert "all of it" in shown

    run("module", "export", "plane", str(tmp_path / "plane.npz"))
    assert "Module 'copy' is there with 200 samples" in run(
        "module", "import", str(tmp_path / "plane.npz"), "--name", "copy"
    )
    run("module", "delete", "plane", "--yes")
    assert "plane" not in run("module", "list").replace("plane.npz", "")
    assert re.search(r"train +plane", run("job", "list"))


STEPS = """\
key grasp
look grasp
goal grasp
close grasp
finish
"""


def test_a_person_records_and_the_robot_does_it(lab: Lab, run: Run) -> None:
    lab.coordinator.show_object("blue cup", "backgrounds", 0.0)
    lab.coordinator.show_object("blue cup", "examples", 0.0)
    lab.teach(lab.places)
    lab.world.cup = np.array([240.0, 320.0, 150.0])
    said = run("record", "pick", "--object", "blue cup", text=STEPS)
    assert "Demonstration 'pick-1' is finished" in said
    assert "'pick-1' was replayed in 4 motions" in run("replay", "pick-1")
    assert lab.robot.commands[-4:] == ["move_to_joints", "move_to_joints", "move_to_joints", "close_gripper"]

    lab.world.joints = lab.robot.description.park.copy()
    assert "close_gripper" in run("train", "grasp")
    said = run("run", "grasp", "--object", "blue cup")
    job = re.search(r"handeye job show (\w+)", said)
    assert job is not None
    why = run("job", "show", job[1])
    assert "Task 'grasp' with 'blue cup': succeeded" in why
    assert re.search(r"answer +-?\d\.\d{4}", why)
    assert re.search(r"grasp-\d+ \(\d+%\)", why)
    run("stop", "--reason", "a cat")
    assert lab.robot.stopped == "a cat"
    run("reset")


def test_what_was_shown_is_labelled_and_deleted(lab: Lab, run: Run) -> None:
    lab.teach(lab.places)
    shown = run("demonstration", "show", "grasp-1")
    assert "Demonstration 'grasp-1' of task 'grasp' with 'blue cup': finished" in shown
    assert "close_gripper" in shown
    assert "goal" in shown
    assert "is labelled a failure" in run("demonstration", "label", "grasp-1", "failure")
    assert re.search(r"grasp-1 .*failure", run("demonstration", "list"))
    trained = run("train", "grasp")
    assert f"from {len(lab.places) - 1} demonstrations" in trained
    assert "has no label" in run("demonstration", "label", "grasp-1", "none")
    run("demonstration", "delete", "grasp-1", "--yes")
    assert not re.search(r"grasp-1\b", run("demonstration", "list"))
    assert "grasp-2" in run("demonstration", "list")


def test_tokens(run: Run) -> None:
    made = run("token", "create", "guest", "--role", "viewer", "--days", "2")
    number = re.search(r"Token (\S+) of 'guest'", made)
    assert number is not None
    assert "guest" in run("token", "list")
    run("token", "revoke", number[1])
    assert "guest" not in run("token", "list")
