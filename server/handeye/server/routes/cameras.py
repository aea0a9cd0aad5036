"""The cameras: what each sees."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query, Response

from handeye.server.pictures import jpeg
from handeye.server.problem import picture_responses
from handeye.server.routes import CoordinatorDep

router = APIRouter(prefix="/v1/cameras", tags=["cameras"])


@router.get("/{camera}/frame", response_class=Response, responses=picture_responses(503, 504))
def camera_frame(
    camera: Literal["left", "right", "observer"],
    coordinator: CoordinatorDep,
    not_older_than: Annotated[float, Query(ge=0.0, allow_inf_nan=False)] = 0.0,
) -> Response:
    """A picture as JPEG that shows the world at `not_older_than` (world time in s) or later; 0: the newest.

    The header World-Time tells the world time that it shows, in s.
    """
    if camera == "observer":
        frame = coordinator.cameras.grab_observer(not_older_than, coordinator.settings.grab_timeout)
    else:
        pair = coordinator.grab(not_older_than)
        frame = pair.left if camera == "left" else pair.right
    return Response(jpeg(frame.image), media_type="image/jpeg", headers={"World-Time": f"{frame.world_time:.6f}"})
