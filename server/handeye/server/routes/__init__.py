"""The REST routes: one module each for what a caller can name.

Most routes are plain functions, which the framework runs in one pool of threads. Two kinds have lanes of their own:
a stop must not queue behind requests that wait for the cameras, and those must not fill the pool.
"""

from __future__ import annotations

import base64
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

import orjson
from anyio import CapacityLimiter, to_thread
from fastapi import Depends, Query, Request

from handeye.server.access import Access
from handeye.server.coordinator import Coordinator
from handeye.server.metrics import Metrics
from handeye.server.problem import Malformed

T = TypeVar("T")

_STOP_THREADS = 4  # a stop takes what the arm takes to brake
_HEALTH_THREADS = 2  # whoever asks needs no token, and the bus may take a second to answer
_CAMERA_THREADS = 8  # a picture may be waited for some 10 s
_SHOWN = 200  # characters of a header that a sentence repeats


class Lane:
    """Threads for one kind of request: so many at a time, the others wait for their turn."""

    def __init__(self, threads: int) -> None:
        self._limiter = CapacityLimiter(threads)

    async def run(self, work: Callable[[], T]) -> T:
        """What `work` returns or raises, done in a thread of the lane."""
        return await to_thread.run_sync(work, limiter=self._limiter)


class Lanes:
    """The lanes of one application."""

    def __init__(self) -> None:
        self.stop = Lane(_STOP_THREADS)
        self.cameras = Lane(_CAMERA_THREADS)
        self.health = Lane(_HEALTH_THREADS)
        self.streams = 0
        """Live streams that are open."""


def coordinator_of(request: Request) -> Coordinator:
    """The coordinator that a request is for; whatever holders of control ask shows that they are there."""
    coordinator: Coordinator = request.app.state.coordinator
    if lease := request.headers.get("control-lease"):
        coordinator.control.heard(lease)
    return coordinator


def metrics_of(request: Request) -> Metrics:
    """What the server counts."""
    access: Access = request.app.state.access
    return access.metrics


# All async: plain functions would queue for the pool of threads before their route's lane is reached.
async def _coordinator(request: Request) -> Coordinator:
    return coordinator_of(request)


async def _metrics(request: Request) -> Metrics:
    return metrics_of(request)


async def _lanes(request: Request) -> Lanes:
    lanes: Lanes = request.app.state.lanes
    return lanes


async def _stop_lane(request: Request) -> Lane:
    lanes: Lanes = request.app.state.lanes
    return lanes.stop


async def _camera_lane(request: Request) -> Lane:
    lanes: Lanes = request.app.state.lanes
    return lanes.cameras


CoordinatorDep = Annotated[Coordinator, Depends(_coordinator)]
"""The coordinator that a route works on."""


MetricsDep = Annotated[Metrics, Depends(_metrics)]
"""What the server counts."""

LanesDep = Annotated[Lanes, Depends(_lanes)]
"""All lanes."""

StopLaneDep = Annotated[Lane, Depends(_stop_lane)]
"""Where stops are done."""

CameraLaneDep = Annotated[Lane, Depends(_camera_lane)]
"""Where pictures are waited for."""

Limit = Annotated[int, Query(ge=1, le=1000, description="How many items the page has at most.")]

Cursor = Annotated[
    str | None, Query(max_length=400, description="What the page before gave as `next`; the first page has none.")
]


def media_type(request: Request) -> str:
    """What the request says its body is, without parameters; "" when it says nothing."""
    return request.headers.get("content-type", "").partition(";")[0].strip().lower()[:_SHOWN]


def cursor_at(place: list[Any]) -> str:
    """Where the next page begins, for callers to send back unread."""
    return base64.urlsafe_b64encode(orjson.dumps(place)).decode()


def place(given: str | None, *kinds: type | tuple[type, ...]) -> list[Any] | None:
    """What `cursor_at` was given; None for None. `Malformed` when it is not of these kinds."""
    if given is None:
        return None
    try:
        found = orjson.loads(base64.b64decode(given, b"-_", validate=True))
    except ValueError:
        found = None
    if not isinstance(found, list) or len(found) != len(kinds) or not all(map(_is_place, found, kinds)):
        raise Malformed("The cursor is none that a page gave as `next`; begin without one.")
    return found


def _is_place(value: Any, kind: Any) -> bool:
    """Whether a database takes it: no truth values, no numbers below 0 or beyond 64 bits, no text with NUL."""
    if isinstance(value, str):
        return kind is str and "\0" not in value
    return not isinstance(value, bool) and isinstance(value, kind) and 0 <= float(value) < 2**63


__all__ = [
    "CameraLaneDep",
    "CoordinatorDep",
    "Cursor",
    "Lane",
    "Lanes",
    "LanesDep",
    "Limit",
    "MetricsDep",
    "StopLaneDep",
    "coordinator_of",
    "cursor_at",
    "media_type",
    "metrics_of",
    "place",
]
