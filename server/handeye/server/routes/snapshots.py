"""Snapshots of a module: remember, list, roll back, forget."""

from __future__ import annotations

from datetime import UTC, datetime

from fastapi import APIRouter, Response

from handeye.server.problem_responses import responses
from handeye.server.routes import CoordinatorDep
from handeye.server.routes.modules import info
from handeye.server.routes.once import OnceDep
from handeye.server.schemas.base import ModuleName, Name
from handeye.server.schemas.modules import ModuleInfo, SnapshotInfo, SnapshotList, SnapshotRequest
from handeye.server.store.modules import Snapshot

router = APIRouter(prefix="/v1/modules/{module}/snapshots", tags=["snapshots"])


@router.get("", responses=responses(404))
def list_snapshots(module: ModuleName, coordinator: CoordinatorDep) -> SnapshotList:
    """A module's snapshots, oldest first."""
    return SnapshotList(snapshots=tuple(map(_info, coordinator.modules.snapshots(module))))


@router.post("", status_code=201, response_model=SnapshotInfo, responses=responses(404, 409))
def take_snapshot(module: ModuleName, request: SnapshotRequest, coordinator: CoordinatorDep, once: OnceDep) -> Response:
    """Remembers the module's samples and settings as they are now."""
    return once.reply(lambda: (_info(coordinator.modules.snapshot(module, request.name)), None))


@router.post("/{snapshot}/rollback", responses=responses(404))
def roll_back(module: ModuleName, snapshot: Name, coordinator: CoordinatorDep) -> ModuleInfo:
    """Makes the snapshot's samples and settings the module's again; the next query goes by them."""
    return info(coordinator, coordinator.modules.roll_back(module, snapshot))


@router.delete("/{snapshot}", status_code=204, responses=responses(404))
def drop_snapshot(module: ModuleName, snapshot: Name, coordinator: CoordinatorDep) -> None:
    """Forgets a snapshot, and the samples that only it had."""
    coordinator.modules.drop_snapshot(module, snapshot)


def _info(snapshot: Snapshot) -> SnapshotInfo:
    return SnapshotInfo(
        name=snapshot.name, samples=snapshot.samples, created=datetime.fromtimestamp(snapshot.created, UTC)
    )
