"""Objects: registered by showing the scene without them and with them."""

from __future__ import annotations

from functools import partial

from fastapi import APIRouter, Response

from handeye.server.coordinator import Coordinator
from handeye.server.objects import Kind, TaughtObject
from handeye.server.problem_responses import responses
from handeye.server.routes import CameraLaneDep, CoordinatorDep
from handeye.server.routes.once import Once, OnceDep
from handeye.server.schemas.base import Name
from handeye.server.schemas.objects import Grab, ObjectInfo, ObjectList

router = APIRouter(prefix="/v1/objects", tags=["objects"])

_NEWEST = Grab()


@router.get("", responses=responses())
def list_objects(coordinator: CoordinatorDep) -> ObjectList:
    """The objects, in the order of their first pictures."""
    return ObjectList(objects=tuple(_info(taught) for taught in coordinator.objects.all()))


@router.post("/{name}/backgrounds", status_code=201, response_model=ObjectInfo, responses=responses(409, 502, 504))
async def add_background(
    name: Name, coordinator: CoordinatorDep, lane: CameraLaneDep, once: OnceDep, grab: Grab = _NEWEST
) -> Response:
    """Grabs a stereo pair of the scene without the object."""
    return await lane.run(partial(_show, coordinator, once, name, "backgrounds", grab))


@router.post("/{name}/examples", status_code=201, response_model=ObjectInfo, responses=responses(409, 502, 504))
async def add_example(
    name: Name, coordinator: CoordinatorDep, lane: CameraLaneDep, once: OnceDep, grab: Grab = _NEWEST
) -> Response:
    """Grabs a stereo pair of the scene with the object; it is learned from all pairs so far."""
    return await lane.run(partial(_show, coordinator, once, name, "examples", grab))


@router.delete("/{name}", status_code=204, responses=responses(404))
def delete_object(name: Name, coordinator: CoordinatorDep) -> None:
    """Forgets an object and its pictures."""
    coordinator.objects.delete(name)


def _show(coordinator: Coordinator, once: Once, name: str, kind: Kind, grab: Grab) -> Response:
    if (before := once.known()) is not None:
        return before
    pair = coordinator.grab(grab.not_older_than)
    return coordinator.objects.add(name, kind, pair, lambda write: once.reply(lambda: (_info(write()), None)))


def _info(taught: TaughtObject) -> ObjectInfo:
    return ObjectInfo(
        name=taught.name,
        backgrounds=taught.backgrounds,
        examples=taught.examples,
        learned=taught.learned,
    )
