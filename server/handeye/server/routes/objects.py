"""Objects: registered by showing the scene without them and with them."""

from __future__ import annotations

from functools import partial

from fastapi import APIRouter

from handeye.server.objects import TaughtObject
from handeye.server.problem import responses
from handeye.server.routes import CameraLaneDep, CoordinatorDep
from handeye.server.schemas import Grab, Name, ObjectInfo, ObjectList

router = APIRouter(prefix="/v1/objects", tags=["objects"])

_NEWEST = Grab()


@router.get("", responses=responses())
def list_objects(coordinator: CoordinatorDep) -> ObjectList:
    """The objects, in the order of their first pictures."""
    return ObjectList(objects=tuple(_info(taught) for taught in coordinator.objects.all()))


@router.post("/{name}/backgrounds", status_code=201, responses=responses(409, 503, 504))
async def add_background(
    name: Name, coordinator: CoordinatorDep, lane: CameraLaneDep, grab: Grab = _NEWEST
) -> ObjectInfo:
    """Grabs a stereo pair of the scene without the object."""
    return _info(await lane.run(partial(coordinator.show_object, name, "backgrounds", grab.not_older_than)))


@router.post("/{name}/examples", status_code=201, responses=responses(409, 503, 504))
async def add_example(name: Name, coordinator: CoordinatorDep, lane: CameraLaneDep, grab: Grab = _NEWEST) -> ObjectInfo:
    """Grabs a stereo pair of the scene with the object; it is learned from all pairs so far."""
    return _info(await lane.run(partial(coordinator.show_object, name, "examples", grab.not_older_than)))


def _info(taught: TaughtObject) -> ObjectInfo:
    return ObjectInfo(
        name=taught.name,
        backgrounds=len(taught.backgrounds) // 2,
        examples=len(taught.examples) // 2,
        learned=taught.learned,
    )
