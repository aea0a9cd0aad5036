"""A coordinator of the tests' own, and both clients to ask it: every check below runs with each of them."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterator
from typing import cast

import httpx2
import pytest
import typer
from typer.testing import CliRunner, Result

from handeye.client import AsyncClient, Client, HandeyeError, Retries
from handeye.client.verbs import register
from tests.client.blocking import Blocking

Handler = Callable[[httpx2.Request], httpx2.Response]
Connect = Callable[[Handler], Client]

PATIENCE = Retries(attempts=4, first_pause=0.001, longest_pause=0.01)


@pytest.fixture(params=["sync", "async"])
def connect(request: pytest.FixtureRequest) -> Iterator[Connect]:
    """Makes a client whose requests a function answers."""
    if request.param == "sync":
        yield lambda handler: Client(
            "http://coordinator", "secret", transport=httpx2.MockTransport(handler), retries=PATIENCE
        )
        return
    with asyncio.Runner() as runner:

        def connected(handler: Handler) -> Client:
            transport = httpx2.MockTransport(handler)
            client = AsyncClient("http://coordinator", "secret", transport=transport, retries=PATIENCE)
            return cast("Client", Blocking(client, runner))

        yield connected


ROBOT: dict[str, object] = {
    "world_time": 1.0,
    "joints": [0.0] * 6,
    "velocities": [0.0] * 6,
    "point": [0.35, 0.0, 0.2],
    "gripper_opening": 0.09,
    "moving": False,
    "stopped": False,
    "still_since": 0.0,
    "lease_holder": "",
}


def job(state: str, kind: str = "run", error: dict[str, str] | None = None, **more: object) -> dict[str, object]:
    """A job as the coordinator tells it."""
    return {
        "id": "j1",
        "kind": kind,
        "subject": "grasp",
        "object": "cup" if kind == "run" else None,
        "state": state,
        "progress": None,
        "error": error,
        "result": None,
        "created": "2026-11-01T10:00:00Z",
        "started": None,
        "ended": None,
        "something new": 1,
        **more,
    }


def event(number: int, kind: str, data: object) -> str:
    return f"event: {kind}\ndata: {json.dumps(data)}\nid: {number}\n\n"


def streamed(*events: str) -> httpx2.Response:
    return httpx2.Response(200, headers={"content-type": "text/event-stream"}, text="".join(events))


def problem(status: int, code: str, detail: str, **headers: str) -> httpx2.Response:
    content = {"type": "about:blank", "title": "Title", "status": status, "detail": detail, "code": code}
    return httpx2.Response(
        status, json=content, headers={name.replace("_", "-"): each for name, each in headers.items()}
    )


class Script:
    """Answers requests in turn, the last one again and again, and keeps what was asked."""

    def __init__(self, *answers: httpx2.Response | Exception) -> None:
        self._answers = list(answers)
        self.asked: list[httpx2.Request] = []

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        self.asked.append(request)
        answer = self._answers.pop(0) if len(self._answers) > 1 else self._answers[0]
        if isinstance(answer, Exception):
            raise answer
        # Anew, for a client wraps what it was given, each in its own way.
        return httpx2.Response(answer.status_code, headers=answer.headers, content=answer.content)

    @property
    def keys(self) -> list[str | None]:
        """The Idempotency-Keys of the requests."""
        return [request.headers.get("idempotency-key") for request in self.asked]


AT = ["--url", "http://coordinator", "--token", "secret"]

Run = Callable[..., Result]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs a command against a coordinator."""
    app = typer.Typer()
    register(app)

    def invoked(coordinator: Handler, *arguments: str, text: str = "") -> Result:
        transport = httpx2.MockTransport(coordinator)
        monkeypatch.setattr(
            "handeye.client.verbs_common.Client",
            lambda url, token: Client(url, token, transport=transport, retries=PATIENCE),
        )
        group = 2 if arguments[0] in ("module", "demonstration", "job", "token") else 1
        return CliRunner().invoke(app, [*arguments[:group], *AT, *arguments[group:]], input=text)

    return invoked


def said(result: Result) -> str:
    """All that a command said, with its error, on one line."""
    assert "secret" not in result.output
    error = str(result.exception) if isinstance(result.exception, HandeyeError) else ""
    return " ".join(f"{result.output} {error}".split())
