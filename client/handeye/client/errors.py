"""What can go wrong for a client: one tree, `HandeyeError` at its root."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from handeye.client.models import Job


class HandeyeError(Exception):
    """Anything that this package raises on purpose. `str(error)` is a sentence for people."""


class Unreachable(HandeyeError):
    """The coordinator does not answer: wrong address, not running, too slow, or the connection broke."""


class Silent(Unreachable):
    """Nothing came on an open stream for too long."""


class TimedOut(HandeyeError):
    """What was waited for did not happen in time."""


class NotConfigured(HandeyeError):
    """It is not known where the coordinator is or which token it wants."""


class Closed(HandeyeError):
    """The client was closed, or its `with` block was left."""


class UnexpectedAnswer(HandeyeError):
    """What answers is no coordinator of this version."""


class WrongArrays(HandeyeError, ValueError):
    """Arrays that cannot be samples or queries: their shapes do not fit each other, or a value is not finite."""


class ApiError(HandeyeError):
    """The coordinator refused a request: HTTP status, its title, a sentence (`detail`) and a stable `code`.

    `retry_after`: the s after which the coordinator says that it may be asked again; None when it says nothing.
    """

    def __init__(self, status: int, title: str, detail: str, code: str = "", retry_after: float | None = None) -> None:
        super().__init__(f"{detail} ({status} {title})")
        self.status = status
        self.title = title
        self.detail = detail
        self.code = code
        self.retry_after = retry_after


class PartlyAdded(HandeyeError):
    """Samples are sent in batches, and one failed: `numbers` (n,) are those of the first n samples, which are kept."""

    def __init__(self, numbers: NDArray[np.int64], total: int, reason: HandeyeError) -> None:
        super().__init__(f"The first {len(numbers)} of {total} samples were added, then: {reason}")
        self.numbers = numbers


class LeaseLost(HandeyeError):
    """Control of the robot was lost; a motion under way has been braked or will be within 2 s."""


class JobFailed(HandeyeError):
    """A job failed, was cancelled or interrupted; `job` has what it did until then."""

    def __init__(self, job: Job) -> None:
        super().__init__(job.failure)
        self.job = job
