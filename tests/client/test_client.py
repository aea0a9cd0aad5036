"""The client alone: how it reads answers, follows jobs, and where it finds the coordinator."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import httpx2
import pytest

from handeye.client import ApiError, Closed, JobFailed, NotConfigured, UnexpectedAnswer, Unreachable
from handeye.client.connection import Connection, find, state_file
from handeye.client.models import Job, JobEvent, MotionJob, Robot, RunJob, TrainJob, TrainStatistics
from tests.client.conftest import ROBOT, Connect, Script, event, job, streamed


def test_names_are_escaped_and_the_token_is_sent(connect: Connect) -> None:
    taught = {"name": "a/b c", "backgrounds": 1, "examples": 0, "learned": False}
    coordinator = Script(httpx2.Response(201, json=taught))
    with connect(coordinator) as client:
        assert not client.add_background("a/b c", not_older_than=2.5).learned
    (asked,) = coordinator.asked
    assert asked.url.raw_path == b"/v1/objects/a%2Fb%20c/backgrounds"
    assert asked.headers["authorization"] == "Bearer secret"
    assert json.loads(asked.content) == {"not_older_than": 2.5}


def test_a_refusal_that_is_no_problem_is_still_an_api_error(connect: Connect) -> None:
    coordinator = Script(httpx2.Response(500, text="<html>it broke</html>"))
    with connect(coordinator) as client, pytest.raises(ApiError, match="it broke") as refusal:
        client.robot()
    assert refusal.value.status == 500


@pytest.mark.parametrize("text", ["<html>hello</html>", "{}", "[]"])
def test_another_server_is_noticed(connect: Connect, text: str) -> None:
    coordinator = Script(httpx2.Response(200, text=text))
    with connect(coordinator) as client, pytest.raises(UnexpectedAnswer, match="http://coordinator is no coordinator"):
        client.robot()


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (httpx2.Response(200, text="hello"), "text/event-stream"),
        (streamed("event: state\ndata: [1]\nid: 1\n\n"), "JSON object"),
        (streamed("event: state\ndata: {}\n\n"), "invalid literal"),
    ],
)
def test_another_servers_events_are_noticed(connect: Connect, answer: httpx2.Response, message: str) -> None:
    with connect(Script(answer)) as client, pytest.raises(UnexpectedAnswer, match=message):
        list(client.events("j1"))


def test_a_job_is_read_as_its_kind() -> None:
    run, train, motion = (Job.model_validate(job("running", kind)) for kind in ("run", "train", "motion"))
    assert isinstance(run, RunJob)
    assert run.result.subtasks == ()
    assert isinstance(train, TrainJob)
    assert isinstance(motion, MotionJob)
    assert not motion.ended
    other = Job.model_validate_json(json.dumps(job("interrupted", "dance")))
    assert type(other) is Job
    assert other.ended
    assert other.failure == "Job 'grasp' was interrupted: it has not ended"


def test_what_a_job_left_behind_has_its_type() -> None:
    ended = Job.model_validate(job("succeeded", "motion", result=ROBOT))
    assert isinstance(ended.result, Robot)
    statistics = {"task": "grasp", "module": "IJS.grasp", "demonstrations": [], "pairs": 0, "subtasks": []}
    trained = Job.model_validate(
        job("succeeded", "train", result={**statistics, "approximator": {}, "frame": "picture"})
    )
    assert isinstance(trained.result, TrainStatistics)


def test_a_failed_job_tells_which_subtask_and_why() -> None:
    """That of the last attempt: the task may have begun again."""
    failed = job("failed", error={"code": "not_seen", "message": "the hand is hidden"})
    tried: dict[str, Any] = {"started": 0.0, "ended": None, "aligned": False, "action": None, "looks": []}
    failed["result"] = {"subtasks": [{"name": name, "state": "failed", **tried} for name in ("hold", "approach")]}
    with pytest.raises(JobFailed, match=r"Task 'grasp' failed in subtask 'approach': the hand is hidden"):
        Job.model_validate(failed).raise_for_failure()


def test_a_broken_event_stream_is_taken_up_where_it_broke(connect: Connect) -> None:
    asked: list[str] = []

    def answer(request: httpx2.Request) -> httpx2.Response:
        if not request.url.path.endswith("/events"):
            return httpx2.Response(200, json=job("succeeded"))
        asked.append(request.headers["last-event-id"])
        if len(asked) == 1:
            headers = {"content-type": "text/event-stream"}
            return httpx2.Response(200, headers=headers, stream=Broken(event(1, "state", job("running"))))
        return streamed(event(2, "state", job("succeeded")))

    numbers: list[int] = []
    with connect(answer) as client:
        assert client.follow("j1", 5.0, lambda e: numbers.append(e.number)).succeeded
    assert (asked, numbers) == (["0", "1"], [1, 2])


class Broken(httpx2.SyncByteStream, httpx2.AsyncByteStream):
    """A stream that breaks after its first words."""

    def __init__(self, text: str, error: Exception | None = None) -> None:
        self._text = text
        self._error = error or httpx2.ReadError("connection reset")

    def __iter__(self) -> object:  # type: ignore[override]
        yield self._text.encode()
        raise self._error

    async def __aiter__(self) -> object:  # type: ignore[override]
        yield self._text.encode()
        raise self._error


def test_silence_is_no_break_while_the_coordinator_answers(connect: Connect) -> None:
    silences = 6

    def answer(request: httpx2.Request) -> httpx2.Response:
        nonlocal silences
        if not request.url.path.endswith("/events"):
            return httpx2.Response(200, json=job("running" if silences else "succeeded"))
        silences -= 1
        if silences:
            headers = {"content-type": "text/event-stream"}
            return httpx2.Response(200, headers=headers, stream=Broken(": ping\n\n", httpx2.ReadTimeout("silence")))
        return streamed(event(1, "state", job("succeeded")))

    with connect(answer) as client:
        assert client.follow("j1", 30.0).succeeded


def test_a_coordinator_that_is_gone_ends_the_wait(connect: Connect) -> None:
    with connect(Script(httpx2.ConnectError("refused"))) as client, pytest.raises(Unreachable, match="refused"):
        client.follow("j1", 60.0)


@pytest.mark.parametrize("how", [KeyboardInterrupt, ValueError])
def test_a_wait_that_ends_early_cancels_the_job(connect: Connect, how: type[BaseException]) -> None:
    asked: list[str] = []

    def answer(request: httpx2.Request) -> httpx2.Response:
        asked.append(request.url.path)
        if request.url.path.endswith("/events"):
            return streamed(event(1, "state", job("running")))
        return httpx2.Response(202, json=job("running"))

    def listener(_event: JobEvent) -> None:
        raise how

    with connect(answer) as client, pytest.raises(how):
        client.run_task("grasp", "cup", on_event=listener)
    assert asked == ["/v1/tasks/grasp/runs", "/v1/jobs/j1/events", "/v1/jobs/j1/cancel"]


def test_training_waits_for_its_end(connect: Connect) -> None:
    result = {
        "task": "grasp",
        "module": "IJS.grasp",
        "demonstrations": ["grasp-1"],
        "pairs": 4,
        "subtasks": [],
        "approximator": {"method": "kndb"},
        "frame": "picture",
    }
    ended = job("succeeded", "train", result=result)

    def answer(request: httpx2.Request) -> httpx2.Response:
        if request.method == "POST":
            assert json.loads(request.content) == {"pairs": "key", "approximator": "kndb", "frame": None}
            return httpx2.Response(202, json=job("queued", "train"))
        if request.url.path.endswith("/events"):
            return streamed(event(1, "progress", {"progress": 0.5}), event(2, "state", ended))
        return httpx2.Response(200, json=ended)

    events: list[JobEvent] = []
    with connect(answer) as client:
        statistics = client.train("grasp", on_event=events.append, pairs="key", approximator="kndb")
    assert statistics.pairs == 4
    assert [each.kind for each in events] == ["progress", "state"]


def test_a_training_that_fails_says_why(connect: Connect) -> None:
    failed = job("failed", "train", error={"code": "not_teachable", "message": "they disagree"})

    def answer(request: httpx2.Request) -> httpx2.Response:
        return streamed() if request.url.path.endswith("/events") else httpx2.Response(202, json=failed)

    with connect(answer) as client, pytest.raises(JobFailed, match="Training 'grasp' failed: they disagree"):
        client.train("grasp")


def test_lists_are_read_page_by_page(connect: Connect) -> None:
    asked: list[str] = []

    def answer(request: httpx2.Request) -> httpx2.Response:
        asked.append(request.url.query.decode())
        cursor = request.url.params.get("cursor")
        return httpx2.Response(
            200, json={"jobs": [job("succeeded"), job("running", "train")], "next": None if cursor == "b" else "b"}
        )

    with connect(answer) as client:
        assert [each.kind for each in client.jobs(limit=3)] == ["run", "train", "run"]
    assert asked == ["limit=3", "limit=3&cursor=b"]


def test_a_closed_client_says_so(connect: Connect) -> None:
    with connect(Script(httpx2.Response(200, json=ROBOT))) as client:
        client.robot()
    with pytest.raises(Closed, match="make another one"):
        client.robot()
    with pytest.raises(Closed):
        list(client.events("j1"))


def test_a_list_without_end_is_noticed(connect: Connect) -> None:
    endless = Script(httpx2.Response(200, json={"jobs": [job("succeeded")], "next": "again"}))
    with connect(endless) as client, pytest.raises(UnexpectedAnswer, match="does not come to its end"):
        client.jobs()


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
