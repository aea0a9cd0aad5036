"""Modules: declare, list, delete; train anew; look inside; export and import."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

from anyio import to_thread
from fastapi import APIRouter, Query, Request, Response

from handeye.server.arrays import MEDIA_TYPE, exported, imported
from handeye.server.coordinator import Coordinator
from handeye.server.problem import UnsupportedMediaType
from handeye.server.problem_responses import responses
from handeye.server.results import JobView, ModuleStatistics
from handeye.server.routes import CoordinatorDep, Cursor, Limit, MetricsDep, cursor_at, media_type, place
from handeye.server.routes.once import OnceDep
from handeye.server.schemas.base import ModuleName
from handeye.server.schemas.modules import ModuleInfo, ModulePage, NewModule, RetrainRequest, TreeInfo
from handeye.server.statistics import tree_of
from handeye.server.store import modules as stored
from handeye.server.store.modules import StoredModule

router = APIRouter(prefix="/v1/modules", tags=["modules"])

_AS_BEFORE = RetrainRequest()
_ARRAYS = {MEDIA_TYPE: {"schema": {"type": "string", "format": "binary"}}}


@router.get("", responses=responses())
def list_modules(coordinator: CoordinatorDep, limit: Limit = 100, cursor: Cursor = None) -> ModulePage:
    """The modules, by name."""
    begin = place(cursor, str)
    found = [m for m in coordinator.modules.all() if begin is None or m.name > begin[0]]
    shown = found[:limit]
    following = cursor_at([shown[-1].name]) if len(found) > limit else None
    return ModulePage(modules=tuple(info(coordinator, module) for module in shown), next=following)


@router.post("", status_code=201, response_model=ModuleInfo, responses=responses(409))
def create_module(declaration: NewModule, coordinator: CoordinatorDep, once: OnceDep) -> Response:
    """Declares a module; it learns from samples."""

    def work() -> tuple[ModuleInfo, str]:
        module = coordinator.modules.create(declaration)
        return info(coordinator, module), f"/v1/modules/{module.name}"

    return once.reply(work)


@router.get("/{module}", responses=responses(404))
def get_module(module: ModuleName, coordinator: CoordinatorDep) -> ModuleInfo:
    """What a module is, and how much it was taught."""
    return info(coordinator, coordinator.modules.stored(module))


@router.delete("/{module}", status_code=204, responses=responses(404, 409))
def delete_module(module: ModuleName, coordinator: CoordinatorDep, metrics: MetricsDep) -> None:
    """Deletes a module with its samples and snapshots; not while a trained task answers by it."""
    coordinator.modules.delete(module)
    metrics.forget_module(module)


@router.post("/{module}/train", status_code=202, response_model=JobView, responses=responses(404, 409))
def train_module(
    module: ModuleName, coordinator: CoordinatorDep, once: OnceDep, request: RetrainRequest = _AS_BEFORE
) -> Response:
    """Starts a job that builds the module anew from its samples, with other settings if they are given."""

    def work() -> tuple[JobView, str]:
        job = coordinator.train_module(module, request.approximator)
        return job.view(), f"/v1/jobs/{job.id}"

    return once.reply(work, 202)


@router.get("/{module}/statistics", responses=responses(404))
def get_statistics(module: ModuleName, coordinator: CoordinatorDep) -> ModuleStatistics:
    """What a module learned, for each combination of categories."""
    return coordinator.statistics(module)


@router.get("/{module}/tree", responses=responses(404))
def get_tree(
    module: ModuleName,
    coordinator: CoordinatorDep,
    category: Annotated[tuple[float, ...], Query(description="Values of the categorical components.")] = (),
) -> TreeInfo:
    """The module's tree for a drawing: nodes, breadth first, and the inputs that they stand for."""
    return tree_of(module, coordinator.modules.live(module), category)


@router.get("/{module}/export", response_class=Response, responses={**responses(404), 200: {"content": _ARRAYS}})
def export_module(module: ModuleName, coordinator: CoordinatorDep) -> Response:
    """The module with its samples as one file, which `numpy.load` reads."""
    with coordinator.store.read() as connection:
        found = coordinator.modules.stored(module)
        content = exported(found, list(stored.read_samples(connection, found)))
    headers = {"Content-Disposition": 'attachment; filename="module.npz"'}
    return Response(content, media_type=MEDIA_TYPE, headers=headers)


@router.post(
    "/import",
    status_code=201,
    response_model=ModuleInfo,
    responses=responses(409),
    openapi_extra={"requestBody": {"required": True, "content": _ARRAYS}},
)
async def import_module(
    request: Request,
    coordinator: CoordinatorDep,
    once: OnceDep,
    name: Annotated[ModuleName | None, Query(description="What to call it; as in the file when not given.")] = None,
) -> Response:
    """Makes a module of a file that `export` gave; its samples are numbered anew."""
    if (kind := media_type(request)) != MEDIA_TYPE:
        raise UnsupportedMediaType(f"Send {MEDIA_TYPE}, not {kind}.")
    content = await request.body()

    def work() -> Response:
        if (before := once.known()) is not None:
            return before
        declaration, samples = imported(content)
        if name is not None:
            declaration = declaration.model_copy(update={"name": name})

        def write() -> tuple[ModuleInfo, str]:
            coordinator.modules.create(declaration)
            if samples.inputs.size or samples.outputs.size:
                coordinator.modules.fill(declaration.name, samples)
            made = coordinator.modules.stored(declaration.name)
            return info(coordinator, made), f"/v1/modules/{made.name}"

        return once.reply(write)

    return await to_thread.run_sync(work)


def info(coordinator: Coordinator, module: StoredModule) -> ModuleInfo:
    """A module as callers see it."""
    with coordinator.store.read() as connection:
        return ModuleInfo(
            name=module.name,
            declaration=module.declaration,
            samples=stored.count(connection, module.name),
            demonstrations=len(stored.demonstrations_of(connection, module.name)),
            created=datetime.fromtimestamp(module.created, UTC),
        )
