"""What can go wrong for a client: one tree, `HandeyeError` at its root."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from handeye.client.models import Job


class HandeyeError(Exception):
    """Anything that this package raises on purpose. `str(error)` is a sentence for people."""


class Unreachable(HandeyeError):
    """The coordinator does not answer: wrong address, not running, or the connection broke."""


class TimedOut(HandeyeError):
    """What was waited for did not happen in time."""


class NotConfigured(HandeyeError):
    """It is not known where the coordinator is or which token it wants."""


class UnexpectedAnswer(HandeyeError):
    """What answers is no coordinator of this version."""


class ApiError(HandeyeError):
    """The coordinator refused a request: HTTP status, its title, a sentence (`detail`) and a stable `code`."""

    def __init__(self, status: int, title: str, detail: str, code: str = "") -> None:
        super().__init__(f"{detail} ({status} {title})")
        self.status = status
        self.title = title
        self.detail = detail
        self.code = code


class JobFailed(HandeyeError):
    """A job failed or was cancelled; `job` has its looks and moves."""

    def __init__(self, job: Job) -> None:
        super().__init__(job.failure)
        self.job = job
