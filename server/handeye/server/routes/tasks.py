"""Tasks: train them from demonstrations, run them as jobs."""

from __future__ import annotations

from fastapi import APIRouter, Response

from handeye.server.problem import responses
from handeye.server.results import JobView
from handeye.server.routes import CoordinatorDep
from handeye.server.schemas import Name, RunRequest
from handeye.server.training import TrainRequest, TrainStatistics

router = APIRouter(prefix="/v1/tasks", tags=["tasks"])

_DEFAULTS = TrainRequest()


@router.post("/{task}/train", responses=responses(404, 409))
def train_task(task: Name, coordinator: CoordinatorDep, request: TrainRequest = _DEFAULTS) -> TrainStatistics:
    """Builds module IJS from the task's finished demonstrations; a trained task is replaced."""
    return coordinator.train(task, request)


@router.post("/{task}/runs", status_code=202, responses=responses(404, 409))
def run_task(task: Name, request: RunRequest, coordinator: CoordinatorDep, response: Response) -> JobView:
    """Starts a job that does the task; follow it at Location."""
    job = coordinator.run(task, request.object, one_look=request.one_look)
    response.headers["Location"] = f"/v1/jobs/{job.id}"
    return job.view()
