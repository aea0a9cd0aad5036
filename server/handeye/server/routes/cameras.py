"""The cameras: what each sees."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Response

from handeye.camera_bridge.driver import Frame
from handeye.server.coordinator import Coordinator
from handeye.server.pictures import jpeg
from handeye.server.problem import picture_responses
from handeye.server.routes import CameraLaneDep, CoordinatorDep

Camera = Literal["left", "right", "observer"]

router = APIRouter(prefix="/v1/cameras", tags=["cameras"])


@router.get("/{camera}/frame", response_class=Response, responses=picture_responses(503, 504))
async def camera_frame(
    camera: Camera,
    coordinator: CoordinatorDep,
    lane: CameraLaneDep,
    not_older_than: Annotated[float, Query(ge=0.0, allow_inf_nan=False)] = 0.0,
) -> Response:
    """A picture as JPEG that shows the world at `not_older_than` (world time in s) or later; 0: the newest.

    The header World-Time tells the world time that it shows, in s.
    """
    return await lane.run(partial(_response, coordinator, camera, not_older_than))


def _response(coordinator: Coordinator, camera: Camera, not_older_than: float) -> Response:
    frame = _frame(coordinator, camera, not_older_than)
    return Response(jpeg(frame.image), media_type="image/jpeg", headers={"World-Time": f"{frame.world_time:.6f}"})


def _frame(coordinator: Coordinator, camera: Camera, not_older_than: float) -> Frame:
    if camera == "observer":
        return coordinator.cameras.grab_observer(not_older_than, coordinator.settings.grab_timeout)
    pair = coordinator.grab(not_older_than)
    return pair.left if camera == "left" else pair.right
