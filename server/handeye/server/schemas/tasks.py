"""The bodies of trained tasks, their runs, and jobs."""

from __future__ import annotations

from pydantic import Field, StrictBool

from handeye.server.results import JobView
from handeye.server.schemas.base import Body, Name
from handeye.server.schemas.demonstrations import SubtaskInfo


class TaskInfo(Body):
    """A trained task: its subtasks in order, the module that answers in them, and whom it was taught by."""

    name: str
    module: str
    subtasks: tuple[SubtaskInfo, ...]
    demonstrations: tuple[str, ...]


class TaskList(Body):
    """The trained tasks, by name."""

    tasks: tuple[TaskInfo, ...]


class RunRequest(Body):
    """What to do the task with."""

    object: Name
    one_look: StrictBool = False
    """One answer per subtask without looking again, as the thesis does."""
    least_support: float | None = Field(default=None, ge=0.0, le=1.0, strict=True)
    """The arm is not moved by an answer with less support; null: as the server is set. 0 never holds, so somebody
    should stand by the stop."""


class JobPage(Body):
    """Jobs, newest first."""

    jobs: tuple[JobView, ...]
    next: str | None
    """The cursor of the next page; null at the end."""
