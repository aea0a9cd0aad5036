"""What a run of a task tells of itself: each step is durable, with its picture, before anybody hears of it.

A disk may take as long as a whole step. So it is written down while the next look is taken, and the run waits for it
before the robot acts on that look (`settle`).
"""

from __future__ import annotations

import contextvars
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from types import TracebackType
from typing import Any, Self

from sqlalchemy import Connection

from handeye.modules.recognition import NotSeen
from handeye.modules.spaces import ImagePair
from handeye.robot_bridge.driver import Joints
from handeye.server.album import Picture
from handeye.server.eyes import Sighting
from handeye.server.job import Job
from handeye.server.results import LookRecord, NeighbourRecord, RunResult, SubtaskRecord, WaypointRecord
from handeye.server.skill import SkillAnswer

_POLL = 0.02  # s
_NEIGHBOURS_RECORDED = 12  # the nearest ones: an answer may come from every sample of the subtask


class RunRecord:
    """The subtasks that were begun, and all looks and way-points in them. For one thread, while its context is open."""

    def __init__(self, job: Job, keep_alive: Callable[[], None]) -> None:
        """`keep_alive` is called about every 20 ms while it waits for the store."""
        self._job = job
        self._keep_alive = keep_alive
        self._subtasks: list[SubtaskRecord] = []
        self._writer = ThreadPoolExecutor(max_workers=1, thread_name_prefix="record")
        self._pending: list[Future[None]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.shutdown()
        for each in self._pending:
            each.result()

    def settle(self) -> None:
        """Waits until all that was told is durable; raises what kept it from being so, and when the job is cancelled.

        The control lease is kept meanwhile: who trains a task holds the store for as long as that takes.
        """
        while self._pending:
            if wait(self._pending[:1], _POLL).done:
                self._pending.pop(0).result()
            else:
                self._keep_alive()
                self._job.check()

    @property
    def subtasks(self) -> int:
        """How many were begun, those of earlier attempts too."""
        return len(self._subtasks)

    def begun(self, subtask: str, towards: str, world_time: float) -> None:
        """A subtask towards an object begins."""
        self._subtasks.append(SubtaskRecord(name=subtask, object=towards, state="running", started=world_time))
        self._publish("subtask")

    def succeeded(self, world_time: float, aligned: bool, action: str | None) -> None:
        """It is done, its gripper action too."""
        self._update("subtask", state="succeeded", ended=world_time, aligned=aligned, action=action)

    def failed(self) -> None:
        """The subtask under way, if there is one, came to nothing."""
        if self._subtasks and self._subtasks[-1].state == "running":
            self._update("subtask", state="failed")

    def again(self, trouble: Exception) -> None:
        """The task begins anew, and why."""
        self._tell("again", {"message": str(trouble)})

    def stop(self, why: str, *, stopped: bool) -> None:
        """The arm was told to stop, or could not be told."""
        self._tell("stop", {"stopped": stopped, "message": why})

    def not_seen(self, picture: Picture, missing: NotSeen) -> None:
        """A look in which object or hand was not found."""
        data = {"message": str(missing), "picture": picture.path}
        self._tell("not_seen", data, picture.keep)

    def look(
        self,
        picture: Picture,
        sighting: Sighting,
        found: ImagePair,
        told: SkillAnswer,
        moved: Joints | None = None,
    ) -> None:
        """What was seen and answered, and by how much the joints were `moved` then, (joints,) rad; None: not at all."""
        look = LookRecord(
            number=picture.number,
            world_time=sighting.world_time,
            object=(found.object.row, found.object.column, found.object.disparity),
            hand=(found.hand.row, found.hand.column, found.hand.disparity),
            hand_seen=found.hand_confidence > 0.0,
            object_confidence=found.object_confidence,
            hand_confidence=found.hand_confidence,
            delta=tuple(float(value) for value in told.turn.angles),
            support=told.support,
            neighbours=NeighbourRecord.nearest_of(told.answer, _NEIGHBOURS_RECORDED),
            moved=() if moved is None else tuple(float(value) for value in moved),
            picture=picture.path,
        )
        self._subtasks[-1] = self._subtasks[-1].model_copy(update={"looks": (*self._subtasks[-1].looks, look)})
        data = {"subtask": self._subtasks[-1].name, **look.model_dump(mode="json")}
        self._tell("look", data, picture.keep)

    def waypoint(self, told: SkillAnswer, seconds: float, moved: Joints) -> None:
        """A way-point was passed that was to take `seconds` of world time; `moved` (joints,) rad from there before."""
        passed = WaypointRecord(
            delta=tuple(float(value) for value in told.turn.angles),
            seconds=seconds,
            support=told.support,
            neighbours=NeighbourRecord.nearest_of(told.answer, _NEIGHBOURS_RECORDED),
            moved=tuple(float(value) for value in moved),
        )
        self._update("waypoint", way=(*self._subtasks[-1].way, passed))

    def _update(self, kind: str, **changes: object) -> None:
        self._subtasks[-1] = self._subtasks[-1].model_copy(update=changes)
        self._publish(kind)

    def _publish(self, kind: str) -> None:
        data = self._subtasks[-1].model_dump(mode="json", exclude={"looks", "way"})
        self._tell(kind, data)

    def _tell(self, kind: str, data: dict[str, Any], also: Callable[[Connection], object] | None = None) -> None:
        told = contextvars.copy_context()  # the request's id goes with it, into the log
        self._pending.append(self._writer.submit(told.run, self._job.publish, kind, data, self._result(), also))

    def _result(self) -> RunResult:
        return RunResult(subtasks=tuple(self._subtasks))
