"""Objects, demonstrations and tasks: what a person shows, and what the robot then does."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import aclosing
from typing import Any, Literal

from numpy.typing import ArrayLike

from handeye.client._arrays import vector
from handeye.client._async.calls import part
from handeye.client._async.jobs import AsyncJobCalls, ignore
from handeye.client._job_models import OnEvent, RunJob, TrainJob, TrainStatistics
from handeye.client.errors import UnexpectedAnswer
from handeye.client.models import (
    Demonstration,
    Demonstrations,
    Observation,
    Outcome,
    Recording,
    Task,
    Tasks,
    TaughtObject,
    TaughtObjects,
)

Pairs = Literal["all", "key"]
Frame = Literal["picture", "hand"]
Approximator = str | Mapping[str, Any] | None


class AsyncTeachingCalls(AsyncJobCalls):
    """The part of the client for /v1/objects, /v1/demonstrations and /v1/tasks."""

    # Objects

    async def objects(self) -> tuple[TaughtObject, ...]:
        """The objects, in the order of their first pictures."""
        return (await self._get(TaughtObjects, "/v1/objects")).objects

    async def add_background(self, name: str, not_older_than: float = 0.0) -> TaughtObject:
        """Shows the scene without the object; pictures show the world at `not_older_than` (world time, s) or later."""
        return await self._show(name, "backgrounds", not_older_than)

    async def add_example(self, name: str, not_older_than: float = 0.0) -> TaughtObject:
        """Shows the scene with the object; pictures show the world at `not_older_than` (world time, s) or later."""
        return await self._show(name, "examples", not_older_than)

    async def delete_object(self, name: str) -> None:
        """Forgets an object and its pictures."""
        await self._delete(f"/v1/objects/{part(name)}")

    async def _show(self, name: str, kind: str, not_older_than: float) -> TaughtObject:
        body = {"not_older_than": not_older_than}
        return await self._post(TaughtObject, f"/v1/objects/{part(name)}/{kind}", body)

    # Demonstrations

    async def demonstrations(self) -> tuple[Demonstration, ...]:
        """The demonstrations, in the order they were begun."""
        async with aclosing(self._pages(Demonstrations, "/v1/demonstrations")) as pages:
            return tuple([each async for page in pages for each in page.demonstrations])

    async def demonstration(self, demonstration_id: str) -> Demonstration:
        """One demonstration."""
        return await self._get(Demonstration, _path(demonstration_id))

    async def observations(self, demonstration_id: str) -> tuple[Observation, ...]:
        """All that was observed in a demonstration, in order."""
        return (await self._get(Recording, f"{_path(demonstration_id)}/observations")).observations

    async def begin_demonstration(self, task: str, object_name: str) -> Demonstration:
        """Begins to record."""
        return await self._post_once(Demonstration, "/v1/demonstrations", {"task": task, "object": object_name})

    async def observe(
        self,
        demonstration_id: str,
        subtask: str,
        *,
        object_name: str | None = None,
        goal: bool = False,
        key: bool = False,
        object_at: ArrayLike | None = None,
    ) -> Observation:
        """Looks and reads the joints, with the arm at rest. `goal`: the subtask ends here; `key`: it begins here.

        `object_name`: what the subtask is towards; None: the demonstration's object. `object_at`: (row, column,
        disparity) in px of its middle, marked by a person in pictures since which neither it nor the head has moved;
        None: it is looked for.
        """
        body: dict[str, object] = {"subtask": subtask, "object": object_name, "goal": goal, "key": key}
        if object_at is not None:
            body["object_at"] = vector(object_at, "a marked point")
        return await self._post_once(Observation, f"{_path(demonstration_id)}/observations", body)

    async def add_waypoint(self, demonstration_id: str, subtask: str) -> Observation:
        """Reads the joints, with the arm at rest, without looking: a point of the way that goes on from the goal."""
        return await self._post_once(Observation, f"{_path(demonstration_id)}/waypoints", {"subtask": subtask})

    async def mark_action(
        self, demonstration_id: str, subtask: str, action: Literal["close_gripper", "open_gripper"]
    ) -> Demonstration:
        """Says what the person did with the gripper at the end of a subtask."""
        body = {"subtask": subtask, "action": action}
        return await self._post_once(Demonstration, f"{_path(demonstration_id)}/actions", body)

    async def finish_demonstration(self, demonstration_id: str) -> Demonstration:
        """Closes a complete demonstration for training."""
        return await self._post_once(Demonstration, f"{_path(demonstration_id)}/finish")

    async def label_demonstration(self, demonstration_id: str, outcome: Outcome | None) -> Demonstration:
        """Says how a demonstration went; failures are not trained from."""
        return await self._patch(Demonstration, _path(demonstration_id), {"outcome": outcome})

    async def delete_demonstration(self, demonstration_id: str) -> None:
        """Deletes a demonstration; its samples leave every module at once."""
        await self._delete(_path(demonstration_id))

    # Tasks

    async def tasks(self) -> tuple[Task, ...]:
        """The trained tasks, by name."""
        return (await self._get(Tasks, "/v1/tasks")).tasks

    async def task(self, name: str) -> Task:
        """One task."""
        return await self._get(Task, f"/v1/tasks/{part(name)}")

    async def delete_task(self, name: str) -> None:
        """Forgets a trained task and its module; its demonstrations stay."""
        await self._delete(f"/v1/tasks/{part(name)}")

    async def train(
        self,
        task: str,
        *,
        pairs: Pairs = "all",
        approximator: Approximator = None,
        frame: Frame | None = None,
        timeout: float = 600.0,
        on_event: OnEvent = ignore,
    ) -> TrainStatistics:
        """Trains a task from its finished demonstrations and waits for it.

        Args:
            task: its name.
            pairs: "key" for the thesis's bare pairs, one from the beginning of each subtask.
            approximator: how answers are made, a method by name or with its settings; None: as suits a task.
            frame: in whose axes the way from hand to object is told; None: the hand's if CSS was taught.
            timeout: s after which the wait ends. When it ends early, however that is, the training is cancelled.
            on_event: is told the job's events.

        Raises:
            JobFailed: the demonstrations do not make a task.
        """
        job = await self.start_training(task, pairs=pairs, approximator=approximator, frame=frame)
        ended = await self._see_through(job, timeout, on_event)
        result = ended.raise_for_failure().result
        if not isinstance(result, TrainStatistics):
            raise UnexpectedAnswer(f"Job {job.id} has trained task '{task}' and has no statistics of it.")
        return result

    async def start_training(
        self, task: str, *, pairs: Pairs = "all", approximator: Approximator = None, frame: Frame | None = None
    ) -> TrainJob:
        """As `train`, and returns at once."""
        settings = dict(approximator) if isinstance(approximator, Mapping) else approximator
        body = {"pairs": pairs, "approximator": settings, "frame": frame}
        return await self._post_once(TrainJob, f"/v1/tasks/{part(task)}/train", body)

    async def start_run(
        self, task: str, object_name: str, *, one_look: bool = False, least_support: float | None = None
    ) -> RunJob:
        """As `run_task`, and returns at once."""
        body = {"object": object_name, "one_look": one_look, "least_support": least_support}
        return await self._post_once(RunJob, f"/v1/tasks/{part(task)}/runs", body)

    async def run_task(
        self,
        task: str,
        object_name: str,
        *,
        one_look: bool = False,
        least_support: float | None = None,
        timeout: float = 300.0,
        on_event: OnEvent = ignore,
    ) -> RunJob:
        """Does a trained task and returns the ended job, failed ones too: see `Job.raise_for_failure`.

        The arm holds rather than being moved by an answer with less than `least_support` (0..1; None: as the server is
        set).

        When the wait ends early (deadline, Ctrl-C, an error from `on_event`), the job is cancelled and the arm stops.
        """
        job = await self.start_run(task, object_name, one_look=one_look, least_support=least_support)
        return await self._see_through(job, timeout, on_event)


def _path(demonstration_id: str) -> str:
    return f"/v1/demonstrations/{part(demonstration_id)}"
