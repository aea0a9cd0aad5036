"""Which failures are worth another try, and when."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus

from handeye.client.errors import ApiError, HandeyeError, Unreachable

_PASSING = (HTTPStatus.TOO_MANY_REQUESTS, HTTPStatus.BAD_GATEWAY, HTTPStatus.SERVICE_UNAVAILABLE)
"""Not 504: there the coordinator has waited already."""


@dataclass(frozen=True, slots=True)
class Retries:
    """How patiently a request is repeated that may be: it is done once however often it arrives.

    Pauses double from `first_pause` to `longest_pause` s, each shortened by up to a half at random, so that many
    clients do not come back at the same moment. Longer ones that the coordinator asks for (Retry-After) are honoured.
    """

    attempts: int = 4
    first_pause: float = 0.2
    longest_pause: float = 5.0
    longest_attempt: float | None = None
    """Each attempt may take so many s; None: all the time that the call has left."""
    longest_connect: float = 5.0
    """Until a connection stands it may take so many s of them."""

    def pause(self, tried: int, failure: HandeyeError, chance: Callable[[], float] = random.random) -> float | None:
        """The s to wait after attempt `tried` (from 1) failed; None when there is to be no other."""
        asked = failure.retry_after if isinstance(failure, ApiError) else None
        if tried >= self.attempts or not _passes(failure, asked):
            return None
        pause = min(self.longest_pause, self.first_pause * 2.0 ** (tried - 1)) * (1.0 - 0.5 * chance())
        return pause if asked is None else max(pause, asked)


ONCE = Retries(attempts=1)
"""Of what would be done twice, or too late."""

URGENT = Retries(attempts=6, first_pause=0.05, longest_pause=0.4, longest_attempt=6.0, longest_connect=1.0)
"""Of a stop: soon again, and no attempt may use up the time of the others. It answers when the arm has braked."""


def _passes(failure: HandeyeError, asked: float | None) -> bool:
    if isinstance(failure, ApiError):
        # A conflict with a Retry-After: the same request, sent before, is still being done.
        return failure.status in _PASSING or (failure.status == HTTPStatus.CONFLICT and asked is not None)
    return isinstance(failure, Unreachable)


class Deadline:
    """Until when a call, a wait or a job may take."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self._end = time.monotonic() + seconds

    def left(self) -> float:
        """The s that are left, 0 when there are none."""
        return max(0.0, self._end - time.monotonic())

    def passed(self) -> bool:
        """No time is left."""
        return time.monotonic() >= self._end
