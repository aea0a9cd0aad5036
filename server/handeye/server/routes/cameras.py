"""The cameras: what each sees, now and as it goes on."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from typing import Annotated, Literal

from fastapi import APIRouter, Header, Query, Response
from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from handeye.camera_bridge.driver import Frame
from handeye.rpc.errors import RpcError
from handeye.server.arrays import NPY_MEDIA_TYPE, npy
from handeye.server.coordinator import Coordinator
from handeye.server.metrics import Metrics
from handeye.server.pictures import jpeg, png
from handeye.server.problem import TooManyRequests
from handeye.server.problem_responses import responses
from handeye.server.routes import CameraLaneDep, CoordinatorDep, Lane, Lanes, LanesDep, MetricsDep
from handeye.server.schemas.base import LATEST

Camera = Literal["left", "right", "observer"]

router = APIRouter(prefix="/v1/cameras", tags=["cameras"])

_BINARY = {"schema": {"type": "string", "format": "binary"}}
_ENCODERS = {"image/jpeg": jpeg, "image/png": png, NPY_MEDIA_TYPE: npy}
_BOUNDARY = "frame"
_RETRY = 1.0  # s until a stream asks again for a picture that could not be had
_NAP = 0.25  # s until a stream sees that the coordinator ends
_STREAMS = 4  # at a time: each keeps the cameras busy


@router.get(
    "/{camera}/frame",
    response_class=Response,
    responses={
        **responses(502, 504),
        200: {"description": "A picture.", "content": dict.fromkeys(_ENCODERS, _BINARY)},
    },
)
async def camera_frame(
    camera: Camera,
    coordinator: CoordinatorDep,
    lane: CameraLaneDep,
    metrics: MetricsDep,
    not_older_than: Annotated[float, Query(ge=0.0, le=LATEST)] = 0.0,
    accept: Annotated[str, Header()] = "*/*",
) -> Response:
    """A picture that shows the world at `not_older_than` (world time in s) or later; 0: the newest.

    A JPEG file, or what the header Accept asks for: image/png (to the last bit what the camera saw), or
    application/x-npy, an array (rows, columns, 3) of uint8. The header World-Time tells the time that it shows, in s.
    """
    asked = [kind.partition(";")[0].strip() for kind in accept.split(",")]
    kind = next((kind for kind in asked if kind in _ENCODERS), "image/jpeg")

    def work() -> Response:
        frame = _frame(coordinator, camera, not_older_than)
        headers = {"World-Time": f"{frame.world_time:.6f}"}
        return Response(_ENCODERS[kind](frame.image), media_type=kind, headers=headers)

    response = await lane.run(work)
    metrics.frames.labels(camera).inc()
    return response


@router.get(
    "/{camera}/stream",
    response_class=StreamingResponse,
    responses={
        **responses(),
        200: {"description": "JPEG files, one after the other.", "content": {"multipart/x-mixed-replace": _BINARY}},
    },
)
async def camera_stream(
    camera: Camera,
    coordinator: CoordinatorDep,
    lanes: LanesDep,
    metrics: MetricsDep,
    rate: Annotated[float, Query(ge=0.1, le=30.0)] = 5.0,
) -> StreamingResponse:
    """New pictures as they come, at most `rate` a second, until the caller leaves; a browser shows them in an <img>."""
    if lanes.streams >= _STREAMS:
        raise TooManyRequests(f"{_STREAMS} streams are open already, which is as many as there may be.", 1)
    return _Stream(_parts(coordinator, camera, 1.0 / rate, lanes.cameras, metrics), lanes)


class _Stream(StreamingResponse):
    """Counts among the open streams from its making to its end, also when the caller leaves before it begins."""

    def __init__(self, parts: AsyncIterator[bytes], lanes: Lanes) -> None:
        super().__init__(parts, media_type=f"multipart/x-mixed-replace; boundary={_BOUNDARY}")
        self._lanes = lanes
        lanes.streams += 1

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Sends the parts."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._lanes.streams -= 1


async def _parts(
    coordinator: Coordinator, camera: Camera, period: float, lane: Lane, metrics: Metrics
) -> AsyncIterator[bytes]:
    """JPEG files of frames that were not sent before; while the cameras cannot be reached there are none."""
    newest = -1

    def look() -> bytes | None:
        nonlocal newest
        frame = _frame(coordinator, camera, 0.0)
        if frame.sequence == newest:
            return None
        newest = frame.sequence
        metrics.frames.labels(camera).inc()
        return jpeg(frame.image)

    while not coordinator.closing.is_set():
        again = time.monotonic() + period
        try:
            picture = await lane.run(look)
        except RpcError:
            picture, again = None, time.monotonic() + _RETRY
        if picture is not None:
            head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
            yield head.encode() + picture + b"\r\n"
        while (left := again - time.monotonic()) > 0 and not coordinator.closing.is_set():
            await asyncio.sleep(min(left, _NAP))


def _frame(coordinator: Coordinator, camera: Camera, not_older_than: float) -> Frame:
    if camera == "observer":
        return coordinator.cameras.grab_observer(not_older_than, coordinator.settings.grab_timeout)
    pair = coordinator.grab(not_older_than)
    return pair.left if camera == "left" else pair.right
