"""The REST routes: one module each for what a caller can name.

Most routes are plain functions, which the framework runs in one pool of threads. Two kinds have lanes of their own:
a stop must not queue behind requests that wait for the cameras, and those must not fill the pool.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, TypeVar

from anyio import CapacityLimiter, to_thread
from fastapi import Depends, Request

from handeye.server.coordinator import Coordinator

T = TypeVar("T")

_STOP_THREADS = 4  # a stop takes what the arm takes to brake
_CAMERA_THREADS = 8  # a picture may be waited for some 10 s


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


# All async: plain functions would queue for the pool of threads before their route's lane is reached.
async def _coordinator(request: Request) -> Coordinator:
    coordinator: Coordinator = request.app.state.coordinator
    return coordinator


async def _stop_lane(request: Request) -> Lane:
    lanes: Lanes = request.app.state.lanes
    return lanes.stop


async def _camera_lane(request: Request) -> Lane:
    lanes: Lanes = request.app.state.lanes
    return lanes.cameras


CoordinatorDep = Annotated[Coordinator, Depends(_coordinator)]
"""The coordinator that a route works on."""

StopLaneDep = Annotated[Lane, Depends(_stop_lane)]
"""Where stops are done."""

CameraLaneDep = Annotated[Lane, Depends(_camera_lane)]
"""Where pictures are waited for."""

__all__ = ["CameraLaneDep", "CoordinatorDep", "Lane", "Lanes", "StopLaneDep"]
