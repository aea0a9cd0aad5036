"""The client's commands that record demonstrations and replay them."""

from __future__ import annotations

import json
from typing import Any

import httpx2
import pytest

from handeye.client.models import Demonstration, Observation
from handeye.client.verbs_teaching import Step, WrongStep, retrace
from tests.client.conftest import ROBOT, Run, job, problem, said, streamed
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
        if path.endswith("/observations"):
            point = [1.0, 2.0, 3.0]
            seen = {"number": 0, "world_time": 1.0, "object": point, "hand": point, "joints": [0.0] * 6}
            return httpx2.Response(201, json={**seen, **body})
        return httpx2.Response(201, json=DEMONSTRATION)


STEPS = "key lift off\n\nlook lift off\ngoal lift off\nclose lift off\nfinish\n"


def test_a_person_records_line_by_line(run: Run) -> None:
    studio = Studio()
    result = run(studio, "record", "grasp", "--object", "cup", text=STEPS)
    assert result.exit_code == 0
    assert "Demonstration 'grasp-1' is finished; `handeye train grasp` learns from it." in said(result)
    path = "/v1/demonstrations/grasp-1"
    assert studio.asked == [
        ("/v1/demonstrations", {"task": "grasp", "object": "cup"}),
        (f"{path}/observations", {"subtask": "lift off", "goal": False, "key": True}),
        (f"{path}/observations", {"subtask": "lift off", "goal": False, "key": False}),
        (f"{path}/observations", {"subtask": "lift off", "goal": True, "key": False}),
        (f"{path}/actions", {"subtask": "lift off", "action": "close_gripper"}),
        (f"{path}/finish", {}),
    ]


def test_a_recording_that_ends_early_says_so(run: Run) -> None:
    result = run(Studio(), "record", "grasp", "--object", "cup", text="look a\n")
    assert result.exit_code == 1
    assert "Demonstration 'grasp-1' stays unfinished" in said(result)


@pytest.mark.parametrize(("line", "message"), [("jump a", "'jump a' is no step"), ("look", "'look' is no step")])
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
        goal=goal,
        key=False,
        world_time=0.0,
        object=(0.0, 0.0, 0.0),
        hand=(0.0, 0.0, 0.0),
        joints=(joint,),
    )


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
