"""The client's commands that record demonstrations, replay, show, label and delete them."""

from __future__ import annotations

import json
import re
from typing import Any

import httpx2
import pytest

from handeye.client.models import Demonstration, Observation
from handeye.client.verbs_teaching import Step, WrongStep, retrace
from tests.client.conftest import ROBOT, Run, Script, job, problem, said, streamed
from tests.client.test_calls import DEMONSTRATION

# Recording and replaying


class Studio:
    """A coordinator that records."""

    def __init__(self, fail_at: int = 1000) -> None:
        self.asked: list[tuple[str, Any]] = []
        self._fail_at = fail_at

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        path, body = request.url.path, json.loads(request.content or "{}")
        self.asked.append((path, body))
        if len(self.asked) == self._fail_at:
            return problem(422, "not_seen", "The hand is not seen.")
        if path.endswith(("/observations", "/waypoints")):
            point = [1.0, 2.0, 3.0] if path.endswith("/observations") else None
            seen = {
                "number": 0,
                "subtask": body["subtask"],
                "towards": body.get("object") or "cup",
                "goal": body.get("goal", False),
                "key": body.get("key", False),
                "world_time": 1.0,
                "object": point,
                "hand": point,
                "joints": [0.0] * 6,
                "seconds": 0.5,
            }
            return httpx2.Response(201, json=seen)
        return httpx2.Response(201, json=DEMONSTRATION)


STEPS = "key lift off\n\nlook lift off\ngoal lift off\nclose lift off\ngoal tip @ jar\nway tip\n"
STEPS += "look pour (240, 320.5, 150)\nlook pour @ jar (1, 2, 3)\nfinish\n"


def towards(other: str | None) -> dict[str, Any]:
    return {"subtask": "pour", "object": other, "goal": False, "key": False}


def test_a_person_records_line_by_line(run: Run) -> None:
    studio = Studio()
    result = run(studio, "record", "grasp", "--object", "cup", text=STEPS)
    assert result.exit_code == 0
    assert "Demonstration 'grasp-1' is finished; `handeye train grasp` learns from it." in said(result)
    path = "/v1/demonstrations/grasp-1"
    assert studio.asked == [
        ("/v1/demonstrations", {"task": "grasp", "object": "cup"}),
        (f"{path}/observations", {"subtask": "lift off", "object": None, "goal": False, "key": True}),
        (f"{path}/observations", {"subtask": "lift off", "object": None, "goal": False, "key": False}),
        (f"{path}/observations", {"subtask": "lift off", "object": None, "goal": True, "key": False}),
        (f"{path}/actions", {"subtask": "lift off", "action": "close_gripper"}),
        (f"{path}/observations", {"subtask": "tip", "object": "jar", "goal": True, "key": False}),
        (f"{path}/waypoints", {"subtask": "tip"}),
        (f"{path}/observations", {**towards(None), "object_at": [240.0, 320.5, 150.0]}),
        (f"{path}/observations", {**towards("jar"), "object_at": [1.0, 2.0, 3.0]}),
        (f"{path}/finish", {}),
    ]


def test_a_recording_that_ends_early_says_so(run: Run) -> None:
    result = run(Studio(), "record", "grasp", "--object", "cup", text="look a\n")
    assert result.exit_code == 1
    assert "Demonstration 'grasp-1' stays unfinished" in said(result)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("jump a", "'jump a' is no step"),
        ("look", "'look' is no step"),
        ("look a @", "'look a @' is no step; a look is: look SUBTASK @ OBJECT"),
        ("goal a (1, 2)", "(1, 2) is no point; one is three numbers"),
    ],
)
def test_a_line_that_is_no_step_ends_a_script(run: Run, line: str, message: str) -> None:
    result = run(Studio(), "record", "grasp", "--object", "cup", text=f"{line}\n{STEPS}")
    assert isinstance(result.exception, WrongStep)
    assert message in said(result)
    assert "stays unfinished" in said(result)


def test_at_a_terminal_a_step_that_fails_can_be_done_again(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = iter(["look a", "nonsense", *STEPS.splitlines()])
    monkeypatch.setattr("handeye.client.verbs_teaching._interactive", lambda: True)
    monkeypatch.setattr("builtins.input", lambda _prompt: next(lines))
    result = run(Studio(fail_at=2), "record", "grasp", "--object", "cup")
    assert result.exit_code == 0
    assert "The hand is not seen." in said(result)
    assert "'nonsense' is no step" in said(result)


def test_ctrl_c_leaves_a_recording_unfinished(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_prompt: str) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr("handeye.client.verbs_teaching._interactive", lambda: True)
    monkeypatch.setattr("builtins.input", interrupted)
    result = run(Studio(), "record", "grasp", "--object", "cup")
    assert result.exit_code != 0
    assert "stays unfinished" in said(result)


def observed(number: int, subtask: str, joint: float, goal: bool = False) -> Observation:
    return Observation(
        number=number,
        subtask=subtask,
        towards="cup",
        goal=goal,
        key=False,
        world_time=0.0,
        object=(0.0, 0.0, 0.0),
        hand=(0.0, 0.0, 0.0),
        joints=(joint,),
        seconds=0.0,
    )


def test_a_way_is_gone_to_its_end_and_not_back_to_the_goal() -> None:
    content = {
        **DEMONSTRATION,
        "subtasks": [{"name": "a", "action": "open_gripper", "object": None, "way": [1.0, 2.0]}],
    }
    seen = [observed(0, "a", 0.1), observed(1, "a", 0.2, goal=True), observed(2, "a", 0.3), observed(3, "a", 0.4)]
    steps = retrace(Demonstration.model_validate(content), seen)
    assert steps == [*(Step((joint,)) for joint in (0.1, 0.2, 0.3, 0.4)), Step(None, "open_gripper")]


def shown_with(*subtasks: tuple[str, str | None]) -> Demonstration:
    content = {**DEMONSTRATION, "subtasks": [{"name": name, "action": action} for name, action in subtasks]}
    return Demonstration.model_validate(content)


def test_what_was_shown_is_retraced_in_order() -> None:
    shown = shown_with(("approach", None), ("grasp", "close_gripper"))
    observations = [
        observed(0, "approach", 0.0),
        observed(1, "approach", 1.0, goal=True),
        observed(2, "grasp", 1.0),
        observed(3, "grasp", 2.0, goal=True),
        observed(4, "grasp", 1.9),
    ]
    assert retrace(shown, observations) == [
        Step((0.0,)),
        Step((1.0,)),
        Step((1.0,)),
        Step((2.0,)),
        Step((1.9,)),
        Step((2.0,)),  # the scattered looks around a goal come after it: the gripper acts at the goal
        Step(None, "close_gripper"),
    ]


def test_a_demonstration_is_replayed_under_the_lease(run: Run) -> None:
    moved: list[tuple[str, Any]] = []

    def answer(request: httpx2.Request) -> httpx2.Response:
        path = request.url.path
        if path == "/v1/robot/lease":
            return httpx2.Response(201, json={"lease": "the-lease", "holder": "me", "expires_after": 2.0})
        if path.startswith("/v1/robot/actions/"):
            moved.append((path.rsplit("/", 1)[1], json.loads(request.content)))
            return httpx2.Response(202, json=job("queued", "motion"))
        if path.endswith("/observations"):
            seen = [observed(0, "grasp", 0.5, goal=True).model_dump(mode="json")]
            return httpx2.Response(200, json={"observations": seen})
        if path.startswith("/v1/demonstrations/"):
            return httpx2.Response(200, json=shown_with(("grasp", "open_gripper")).model_dump(mode="json"))
        return (
            streamed()
            if path.endswith("/events")
            else httpx2.Response(200, json=job("succeeded", "motion", result=ROBOT))
        )

    result = run(answer, "replay", "grasp-1", "--speed", "0.2")
    assert result.exit_code == 0
    assert "'grasp-1' was replayed in 2 motions." in said(result)
    assert moved == [("move_to_joints", {"joints": [0.5], "pace": {"speed": 0.2}}), ("open_gripper", {})]


# What was shown


def test_demonstrations_are_listed(run: Run) -> None:
    page = {"demonstrations": [DEMONSTRATION, {**DEMONSTRATION, "id": "grasp-2", "outcome": "failure"}], "next": None}
    words = said(run(Script(httpx2.Response(200, json=page)), "demonstration", "list"))
    assert re.search(r"grasp-1 grasp cup recording – 0 0 2026-.* grasp-2 grasp cup recording failure 0 0 2026-", words)
    nothing = httpx2.Response(200, json={"demonstrations": [], "next": None})
    assert said(run(Script(nothing), "demonstration", "list")) == "Demonstrations: none"


def test_a_demonstration_shows_all_that_was_observed(run: Run) -> None:
    shown = {**shown_with(("grasp", "close_gripper")).model_dump(mode="json"), "outcome": "success"}
    seen = [observed(0, "grasp", 0.5), observed(1, "grasp", -0.25, goal=True)]
    coordinator = Script(
        httpx2.Response(200, json=shown),
        httpx2.Response(200, json={"observations": [each.model_dump(mode="json") for each in seen]}),
    )
    words = said(run(coordinator, "demonstration", "show", "grasp-1"))
    assert "Demonstration 'grasp-1' of task 'grasp' with 'cup': recording, success" in words
    assert "grasp close_gripper" in words
    assert "0 grasp – 0 object 0.0 0.0 0.0 0.5000 hand" in words
    assert "1 grasp goal 0 object 0.0 0.0 0.0 -0.2500 hand" in words


@pytest.mark.parametrize(
    ("given", "outcome", "message"),
    [("success", "success", "is labelled a success"), ("none", None, "has no label")],
)
def test_a_demonstration_is_labelled(run: Run, given: str, outcome: str | None, message: str) -> None:
    coordinator = Script(httpx2.Response(200, json={**DEMONSTRATION, "outcome": outcome}))
    words = said(run(coordinator, "demonstration", "label", "grasp-1", given))
    assert f"Demonstration 'grasp-1' {message}; the next `handeye train grasp` goes by it." in words
    (request,) = coordinator.asked
    assert (request.method, request.url.path) == ("PATCH", "/v1/demonstrations/grasp-1")
    assert json.loads(request.content) == {"outcome": outcome}


def test_no_other_label_is_taken(run: Run) -> None:
    coordinator = Script(httpx2.Response(500))
    assert run(coordinator, "demonstration", "label", "grasp-1", "middling").exit_code == 2
    assert not coordinator.asked


def test_a_demonstration_is_deleted_when_it_is_meant(run: Run) -> None:
    coordinator = Script(httpx2.Response(204))
    assert run(coordinator, "demonstration", "delete", "grasp-1", text="n\n").exit_code == 1
    assert not coordinator.asked
    assert "'grasp-1' is deleted" in said(run(coordinator, "demonstration", "delete", "grasp-1", "--yes"))
    (request,) = coordinator.asked
    assert (request.method, request.url.path) == ("DELETE", "/v1/demonstrations/grasp-1")
