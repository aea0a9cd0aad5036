"""The client alone: how it reads answers, where it finds the coordinator, and its command."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable
from pathlib import Path

import httpx2
import pytest
import typer
from typer.testing import CliRunner

from handeye.client import ApiError, Client, HandeyeError, JobFailed, NotConfigured, UnexpectedAnswer, Unreachable
from handeye.client.connection import Connection, find, state_file
from handeye.client.models import Job
from handeye.client.verbs import register, signals_unwind

Handler = Callable[[httpx2.Request], httpx2.Response]


def job(state: str, error: dict[str, str] | None = None) -> dict[str, object]:
    return {
        "id": "j1",
        "task": "grasp",
        "object": "cup",
        "state": state,
        "error": error,
        "result": {"subtasks": []},
        "something new": 1,
    }


def event(number: int, kind: str, data: object) -> str:
    return f"event: {kind}\ndata: {json.dumps(data)}\nid: {number}\n\n"


def client(handler: Handler) -> Client:
    return Client("http://coordinator", "secret", transport=httpx2.MockTransport(handler))


def streamed(*events: str) -> httpx2.Response:
    return httpx2.Response(200, headers={"content-type": "text/event-stream"}, text="".join(events))


def test_names_are_escaped_and_the_token_is_sent() -> None:
    seen: list[httpx2.Request] = []

    def answer(request: httpx2.Request) -> httpx2.Response:
        seen.append(request)
        return httpx2.Response(201, json={"name": "a/b c", "backgrounds": 1, "examples": 0, "learned": False})

    with client(answer) as one:
        assert not one.add_background("a/b c", not_older_than=2.5).learned
    assert seen[0].url.raw_path == b"/v1/objects/a%2Fb%20c/backgrounds"
    assert seen[0].headers["authorization"] == "Bearer secret"
    assert json.loads(seen[0].content) == {"not_older_than": 2.5}


def test_a_refusal_that_is_no_problem_is_still_an_api_error() -> None:
    gateway = client(lambda _: httpx2.Response(502, text="<html>bad gateway</html>"))
    with gateway, pytest.raises(ApiError, match="bad gateway") as refusal:
        gateway.robot()
    assert refusal.value.status == 502


@pytest.mark.parametrize("text", ["<html>hello</html>", "{}", "[]"])
def test_another_server_is_noticed(text: str) -> None:
    other = client(lambda _: httpx2.Response(200, text=text))
    with other, pytest.raises(UnexpectedAnswer, match="http://coordinator is no coordinator"):
        other.robot()


def test_a_broken_event_stream_is_taken_up_where_it_broke() -> None:
    asked: list[str] = []

    def answer(request: httpx2.Request) -> httpx2.Response:
        if not request.url.path.endswith("/events"):
            return httpx2.Response(200, json=job("succeeded"))
        asked.append(request.headers["last-event-id"])
        if len(asked) == 1:

            def broken() -> object:
                yield event(1, "state", job("running")).encode()
                raise httpx2.ReadError("connection reset")

            headers = {"content-type": "text/event-stream"}
            return httpx2.Response(200, headers=headers, content=broken())  # type: ignore[arg-type]
        return streamed(event(2, "state", job("succeeded")))

    kinds: list[int] = []
    with client(answer) as one:
        assert one.follow("j1", 5.0, lambda e: kinds.append(e.number)).succeeded
    assert (asked, kinds) == (["0", "1"], [1, 2])


def test_a_coordinator_that_is_gone_ends_the_wait() -> None:
    def answer(request: httpx2.Request) -> httpx2.Response:
        raise httpx2.ConnectError("refused")

    with client(answer) as one, pytest.raises(Unreachable, match="refused"):
        one.follow("j1", 60.0)


def test_a_failed_job_tells_which_subtask_and_why() -> None:
    failed = job("failed", {"code": "not_seen", "message": "the hand is hidden"})
    failed["result"] = {
        "subtasks": [
            {
                "name": "approach",
                "state": "failed",
                "started": 0.0,
                "ended": None,
                "aligned": False,
                "action": None,
                "looks": [],
            }
        ]
    }
    with pytest.raises(JobFailed, match=r"Task 'grasp' failed in subtask 'approach': the hand is hidden"):
        Job.model_validate(failed).raise_for_failure()


@pytest.fixture
def home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.delenv("HANDEYE_URL", raising=False)
    monkeypatch.delenv("HANDEYE_TOKEN", raising=False)
    return tmp_path


def keep(url: str, token: str) -> None:
    state_file().parent.mkdir()
    state_file().write_text(json.dumps({"url": url, "token": token}))


def test_where_the_coordinator_is(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(NotConfigured, match="handeye up"):
        find()
    keep("http://here:1", "kept")
    assert find() == Connection("http://here:1", "kept")
    assert find("http://here:1/") == Connection("http://here:1/", "kept")
    monkeypatch.setenv("HANDEYE_URL", "http://there:2")
    monkeypatch.setenv("HANDEYE_TOKEN", "set")
    assert find() == Connection("http://there:2", "set")
    assert find("http://third:3", "given") == Connection("http://third:3", "given")


def test_the_kept_token_goes_to_no_other_host(home: Path) -> None:
    keep("http://here:1", "kept")
    with pytest.raises(NotConfigured, match="token of http://there:2"):
        find("http://there:2")


@pytest.mark.parametrize("text", ["", "[]", "{}", "nonsense"])
def test_a_damaged_state_file_is_named(home: Path, text: str) -> None:
    keep("", "")
    state_file().write_text(text)
    with pytest.raises(NotConfigured, match=r"handeye\.json cannot be read"):
        find()


AT = ["--url", "http://coordinator", "--token", "secret"]


def verbs() -> typer.Typer:
    app = typer.Typer()
    register(app)
    return app


def run_verb(monkeypatch: pytest.MonkeyPatch, ended: dict[str, object], look: dict[str, object]) -> tuple[int, str]:
    """`handeye run` against a coordinator whose job ends as `ended`; returns exit code and output."""
    subtask = {"name": "grasp", "state": "running"}
    stream = streamed(event(1, "subtask", subtask), event(2, "look", look), event(3, "state", ended))

    def answer(request: httpx2.Request) -> httpx2.Response:
        if request.method == "POST":
            assert json.loads(request.content) == {"object": "cup", "one_look": True}
            return httpx2.Response(202, json=job("running"))
        return stream if request.url.path.endswith("/events") else httpx2.Response(200, json=ended)

    arguments = ["run", "grasp", "--object", "cup", "--one-look", *AT]
    monkeypatch.setattr("handeye.client.verbs.Client", lambda *_: client(answer))
    result = CliRunner().invoke(verbs(), arguments)
    if result.exception is not None and isinstance(result.exception, HandeyeError):
        return result.exit_code, result.output + str(result.exception)
    return result.exit_code, result.output


LOOK: dict[str, object] = {"number": 0, "delta": [0.1, -0.25], "support": 0.9}


def test_the_command_shows_the_looks_and_succeeds(monkeypatch: pytest.MonkeyPatch) -> None:
    code, output = run_verb(monkeypatch, job("succeeded"), LOOK)
    assert code == 0
    assert "look 0: largest answer 0.2500 rad, support 0.90" in output
    assert "Task 'grasp' with 'cup' succeeded" in output


def test_the_command_fails_with_the_jobs_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    failed = job("failed", {"code": "stopped", "message": "the robot is stopped"})
    code, output = run_verb(monkeypatch, failed, LOOK)
    assert code != 0
    assert "the robot is stopped" in output
    assert "secret" not in output


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_cancels_the_job_of_the_command(monkeypatch: pytest.MonkeyPatch, number: signal.Signals) -> None:
    asked: list[str] = []
    before = signal.getsignal(number)

    def answer(request: httpx2.Request) -> httpx2.Response:
        asked.append(request.url.path)
        if request.url.path.endswith("/events"):
            signal.raise_signal(number)
        return httpx2.Response(202, json=job("running"))

    monkeypatch.setattr("handeye.client.verbs.Client", lambda *_: client(answer))
    result = CliRunner().invoke(verbs(), ["run", "grasp", "--object", "cup", *AT])
    assert result.exit_code == 128 + number
    assert asked == ["/v1/tasks/grasp/runs", "/v1/jobs/j1/events", "/v1/jobs/j1/cancel"]
    assert signal.getsignal(number) is before


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
def test_the_robot_is_stopped_and_reset(
    monkeypatch: pytest.MonkeyPatch, arguments: list[str], path: str, body: dict[str, str] | None
) -> None:
    asked: list[tuple[str, object]] = []
    robot = {
        "world_time": 1.0,
        "joints": [0.0] * 6,
        "velocities": [0.0] * 6,
        "gripper_opening": 0.09,
        "moving": False,
        "stopped": arguments[0] == "stop",
        "still_since": 0.0,
        "lease_holder": "",
    }

    def answer(request: httpx2.Request) -> httpx2.Response:
        asked.append((request.url.path, json.loads(request.content) if request.content else None))
        return httpx2.Response(200, json=robot)

    monkeypatch.setattr("handeye.client.verbs.Client", lambda *_: client(answer))
    result = CliRunner().invoke(verbs(), [*arguments, *AT])
    assert (result.exit_code, asked) == (0, [(path, body)])


def test_a_stop_that_cannot_be_done_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("handeye.client.verbs.Client", lambda *_: client(lambda _: httpx2.Response(503)))
    result = CliRunner().invoke(verbs(), ["stop", *AT])
    assert isinstance(result.exception, ApiError)
