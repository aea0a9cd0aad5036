"""The coordinator from Python: one typed method per route."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from types import TracebackType
from typing import Any, Literal, TypeVar
from urllib.parse import quote

import httpx2
from pydantic import BaseModel, ValidationError

from handeye.client.errors import ApiError, HandeyeError, TimedOut, UnexpectedAnswer, Unreachable
from handeye.client.models import (
    Demonstration,
    Demonstrations,
    Job,
    JobEvent,
    Observation,
    Robot,
    TaughtObject,
    TaughtObjects,
    TrainStatistics,
)

M = TypeVar("M", bound=BaseModel)

_STREAM_SILENCE = 20.0  # s; the coordinator pings an idle event stream every 15 s
_READY_POLL = 0.1  # s between two questions whether the coordinator is ready


def _ignore(_event: JobEvent) -> None:
    """The listener of a job to whose events nobody listens."""


class Client:
    """A connection to a coordinator at `url` with its bearer `token`; use it in a `with` block.

    Every method raises `ApiError` when the coordinator refuses, `Unreachable` when it does not answer within `timeout`
    s. `transport` replaces the network, for tests. Methods may be called from several threads.
    """

    def __init__(
        self, url: str, token: str = "", timeout: float = 30.0, transport: httpx2.BaseTransport | None = None
    ) -> None:
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._url = url
        self._http = httpx2.Client(base_url=url, headers=headers, timeout=timeout, transport=transport)

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    # Health

    def not_ready(self) -> str | None:
        """Why the coordinator cannot work yet; None when it can."""
        try:
            self._call("GET", "/readyz")
        except ApiError as error:
            if error.status == httpx2.codes.SERVICE_UNAVAILABLE:
                return error.detail
            raise
        return None

    def wait_ready(self, timeout: float) -> None:
        """Returns once the coordinator is ready; `TimedOut` after `timeout` s says what is missing."""
        deadline = time.monotonic() + timeout
        while True:
            try:
                missing = self.not_ready()
            except Unreachable as error:
                missing = str(error)
            if missing is None:
                return
            if time.monotonic() >= deadline:
                raise TimedOut(f"The coordinator was not ready within {timeout:g} s. {missing}")
            time.sleep(_READY_POLL)

    # Objects

    def objects(self) -> tuple[TaughtObject, ...]:
        """The objects, in the order of their first pictures."""
        return self._get(TaughtObjects, "/v1/objects").objects

    def add_background(self, name: str, not_older_than: float = 0.0) -> TaughtObject:
        """Shows the scene without the object; pictures show the world at `not_older_than` (world time, s) or later."""
        return self._show(name, "backgrounds", not_older_than)

    def add_example(self, name: str, not_older_than: float = 0.0) -> TaughtObject:
        """Shows the scene with the object; pictures show the world at `not_older_than` (world time, s) or later."""
        return self._show(name, "examples", not_older_than)

    def _show(self, name: str, kind: str, not_older_than: float) -> TaughtObject:
        return self._post(TaughtObject, f"/v1/objects/{_part(name)}/{kind}", {"not_older_than": not_older_than})

    # Demonstrations

    def demonstrations(self) -> tuple[Demonstration, ...]:
        """The demonstrations, in the order they were begun."""
        return self._get(Demonstrations, "/v1/demonstrations").demonstrations

    def begin_demonstration(self, task: str, object_name: str) -> Demonstration:
        """Begins to record."""
        return self._post(Demonstration, "/v1/demonstrations", {"task": task, "object": object_name})

    def observe(self, demonstration_id: str, subtask: str, *, goal: bool = False, key: bool = False) -> Observation:
        """Looks and reads the joints, with the arm at rest. `goal`: the subtask ends here; `key`: it begins here."""
        path = f"/v1/demonstrations/{_part(demonstration_id)}/observations"
        return self._post(Observation, path, {"subtask": subtask, "goal": goal, "key": key})

    def mark_action(
        self, demonstration_id: str, subtask: str, action: Literal["close_gripper", "open_gripper"]
    ) -> Demonstration:
        """Says what the person did with the gripper at the end of a subtask."""
        path = f"/v1/demonstrations/{_part(demonstration_id)}/actions"
        return self._post(Demonstration, path, {"subtask": subtask, "action": action})

    def finish_demonstration(self, demonstration_id: str) -> Demonstration:
        """Closes a complete demonstration for training."""
        return self._post(Demonstration, f"/v1/demonstrations/{_part(demonstration_id)}/finish")

    # Tasks and jobs

    def train(self, task: str, **options: object) -> TrainStatistics:
        """Trains a task from its finished demonstrations; options as in POST /v1/tasks/{task}/train."""
        return self._post(TrainStatistics, f"/v1/tasks/{_part(task)}/train", options)

    def start_run(self, task: str, object_name: str, *, one_look: bool = False) -> Job:
        """Starts a trained task and returns at once."""
        path = f"/v1/tasks/{_part(task)}/runs"
        return self._post(Job, path, {"object": object_name, "one_look": one_look})

    def job(self, job_id: str) -> Job:
        """A job as it is now."""
        return self._get(Job, f"/v1/jobs/{_part(job_id)}")

    def cancel_job(self, job_id: str) -> Job:
        """Asks a job to end; the motion under way is braked."""
        return self._post(Job, f"/v1/jobs/{_part(job_id)}/cancel")

    def events(self, job_id: str, after: int = 0, silence: float = _STREAM_SILENCE) -> Iterator[JobEvent]:
        """A job's events numbered above `after`, as they happen, until it ends.

        `Unreachable` when the stream breaks, or when nothing comes for `silence` s, not even a ping.
        """
        headers = {"Last-Event-ID": str(after)}
        path = f"/v1/jobs/{_part(job_id)}/events"
        try:
            with self._http.stream("GET", path, headers=headers, timeout=silence) as response:
                if response.is_error:
                    response.read()
                    raise _refusal(response)
                for event in httpx2.EventSource(response):
                    yield JobEvent(number=int(event.id), kind=event.event, data=_object(event.json()))
        except httpx2.HTTPError as error:
            raise self._unreachable(error) from error

    def follow(self, job_id: str, timeout: float, on_event: Callable[[JobEvent], None] = _ignore) -> Job:
        """Waits until a job has ended and returns it, whatever its state; `TimedOut` after `timeout` s.

        A broken event stream is taken up again where it broke, once; then `Unreachable`.
        """
        deadline = time.monotonic() + timeout
        seen, broken = 0, False
        while (left := deadline - time.monotonic()) > 0.0:
            before = seen
            try:
                for event in self.events(job_id, seen, min(left, _STREAM_SILENCE)):
                    seen = event.number
                    on_event(event)
                    if time.monotonic() > deadline:
                        break
                job = self.job(job_id)
            except Unreachable:
                if broken and seen == before:
                    raise
                broken = True
                continue
            if job.ended:
                return job
        raise TimedOut(f"Job {job_id} did not end within {timeout:g} s.")

    def run_task(
        self,
        task: str,
        object_name: str,
        *,
        one_look: bool = False,
        timeout: float = 300.0,
        on_event: Callable[[JobEvent], None] = _ignore,
    ) -> Job:
        """Does a trained task and returns the ended job, failed ones too: see `Job.raise_for_failure`.

        When the wait ends early (deadline, Ctrl-C, an error from `on_event`), the job is cancelled and the arm stops.
        """
        job = self.start_run(task, object_name, one_look=one_look)
        try:
            return self.follow(job.id, timeout, on_event)
        except BaseException:
            with suppress(HandeyeError):  # what made us leave is the error to report
                self.cancel_job(job.id)
            raise

    def picture(self, path: str) -> bytes:
        """The JPEG at `path`, such as `Look.picture`."""
        return self._call("GET", path).content

    # Robot and cameras

    def robot(self) -> Robot:
        """The robot's state."""
        return self._get(Robot, "/v1/robot")

    def stop_robot(self, reason: str = "a client asked for it") -> Robot:
        """Brakes a motion under way and latches the software stop. Not safety-rated."""
        return self._post(Robot, "/v1/robot/stop", {"reason": reason})

    def reset_robot(self) -> Robot:
        """Clears the software stop."""
        return self._post(Robot, "/v1/robot/reset")

    def frame(self, camera: Literal["left", "right", "observer"], not_older_than: float = 0.0) -> bytes:
        """A camera's picture as JPEG, showing the world at `not_older_than` (world time, s) or later."""
        query = {"not_older_than": str(not_older_than)}
        return self._call("GET", f"/v1/cameras/{camera}/frame", params=query).content

    # How all of them call

    def _get(self, model: type[M], path: str) -> M:
        return self._read(model, self._call("GET", path))

    def _post(self, model: type[M], path: str, body: Mapping[str, object] | None = None) -> M:
        return self._read(model, self._call("POST", path, json=body))

    def _call(
        self, method: str, path: str, json: Mapping[str, object] | None = None, params: dict[str, str] | None = None
    ) -> httpx2.Response:
        try:
            response = self._http.request(method, path, json=json, params=params)
        except httpx2.HTTPError as error:
            raise self._unreachable(error) from error
        if not response.is_success:
            raise _refusal(response)
        return response

    def _read(self, model: type[M], response: httpx2.Response) -> M:
        try:
            return model.model_validate_json(response.content)
        except ValidationError as error:
            raise UnexpectedAnswer(f"What answers at {self._url} is no coordinator of this version: {error}") from error

    def _unreachable(self, error: httpx2.HTTPError) -> Unreachable:
        reason = str(error) or type(error).__name__
        return Unreachable(f"The coordinator at {self._url} cannot be reached: {reason}. Is it running?")


def _part(name: str) -> str:
    """A name as one part of a path."""
    return quote(name, safe="")


def _object(data: object) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise UnexpectedAnswer(f"an event's data is an object, not {data!r}")
    return data


def _refusal(response: httpx2.Response) -> ApiError:
    """The problem+json (RFC 9457) of a refused request as an error."""
    try:
        problem = _object(response.json())
    except (ValueError, UnexpectedAnswer):
        return ApiError(response.status_code, response.reason_phrase, f"No explanation: {response.text[:200]!r}")
    return ApiError(
        response.status_code,
        str(problem.get("title", response.reason_phrase)),
        str(problem.get("detail", "no detail")),
        str(problem.get("code", "")),
    )
