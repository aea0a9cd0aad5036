"""The store as a whole: a backup as one file, and back. For admins."""

from __future__ import annotations

import tempfile
from pathlib import Path

from anyio import open_file, to_thread
from fastapi import APIRouter, Request, Response
from fastapi.responses import FileResponse
from starlette.background import BackgroundTask

from handeye.server.coordinator import Coordinator
from handeye.server.problem import Invalid
from handeye.server.problem_responses import responses
from handeye.server.routes import CoordinatorDep
from handeye.server.schemas.service import Restored
from handeye.server.store.backup import BackupError, backup
from handeye.server.store.modules import all_modules, count

MEDIA_TYPE = "application/vnd.sqlite3"

router = APIRouter(prefix="/v1", tags=["store"])

_FILE = {MEDIA_TYPE: {"schema": {"type": "string", "format": "binary"}}}


@router.get("/backup", response_class=Response, responses={**responses(), 200: {"content": _FILE}})
def get_backup(coordinator: CoordinatorDep) -> FileResponse:
    """The whole store as it is now, as one SQLite file; writers go on meanwhile."""
    path = _temporary(coordinator)
    try:
        backup(coordinator.store, path)
    except BaseException:
        path.unlink()
        raise
    return FileResponse(path, media_type=MEDIA_TYPE, filename="handeye.db", background=BackgroundTask(path.unlink))


@router.post(
    "/restore",
    responses=responses(409),
    openapi_extra={"requestBody": {"required": True, "content": _FILE}},
)
async def restore_backup(request: Request, coordinator: CoordinatorDep) -> Restored:
    """Puts a backup in the place of everything but the tokens, all or nothing; then all trees are built anew.

    Not while a job is under way or somebody has control of the robot.
    """
    path = _temporary(coordinator)
    try:
        async with await open_file(path, "wb") as file:
            async for piece in request.stream():
                await file.write(piece)
        return await to_thread.run_sync(_restore, coordinator, path)
    finally:
        path.unlink()


def _restore(coordinator: Coordinator, path: Path) -> Restored:
    try:
        coordinator.restore(path)
    except BackupError as error:
        raise Invalid(f"This cannot be restored: {error}.") from error
    with coordinator.store.read() as connection:
        names = [module.name for module in all_modules(connection)]
        return Restored(modules=len(names), samples=sum(count(connection, name) for name in names))


def _temporary(coordinator: Coordinator) -> Path:
    """A new file beside the store, where there is room for such."""
    folder = coordinator.settings.data_dir
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=folder, prefix=".backup-")
    open(handle).close()
    return Path(name)
