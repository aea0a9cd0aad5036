"""Tasks: train them from demonstrations, run them as jobs."""

from __future__ import annotations

from fastapi import APIRouter, Response

from handeye.server.job import Job
from handeye.server.problem_responses import responses
from handeye.server.results import JobView
from handeye.server.routes import CoordinatorDep
from handeye.server.routes.demonstrations import subtask_info
from handeye.server.routes.once import OnceDep
from handeye.server.schemas.base import Name
from handeye.server.schemas.tasks import RunRequest, TaskInfo, TaskList
from handeye.server.training import TrainedTask, TrainRequest

router = APIRouter(prefix="/v1/tasks", tags=["tasks"])

_DEFAULTS = TrainRequest()


@router.get("", responses=responses())
def list_tasks(coordinator: CoordinatorDep) -> TaskList:
    """The trained tasks, by name."""
    return TaskList(tasks=tuple(map(_info, coordinator.tasks.all())))


@router.get("/{task}", responses=responses(404))
def get_task(task: Name, coordinator: CoordinatorDep) -> TaskInfo:
    """A trained task: its subtasks, its module, and whom it was taught by."""
    return _info(coordinator.tasks.get(task))


@router.delete("/{task}", status_code=204, responses=responses(404))
def delete_task(task: Name, coordinator: CoordinatorDep) -> None:
    """Forgets a trained task and its module; its demonstrations stay."""
    coordinator.tasks.delete(task)


@router.post("/{task}/train", status_code=202, response_model=JobView, responses=responses(404, 409))
def train_task(task: Name, coordinator: CoordinatorDep, once: OnceDep, request: TrainRequest = _DEFAULTS) -> Response:
    """Starts a job that builds module IJS from the task's finished demonstrations; a trained task is replaced."""
    return once.reply(lambda: _accepted(coordinator.train_task(task, request)), 202)


@router.post("/{task}/runs", status_code=202, response_model=JobView, responses=responses(404, 409))
def run_task(task: Name, request: RunRequest, coordinator: CoordinatorDep, once: OnceDep) -> Response:
    """Starts a job that does the task; follow it at Location."""

    def run() -> tuple[JobView, str]:
        started = coordinator.run(task, request.object, one_look=request.one_look, least_support=request.least_support)
        return _accepted(started)

    return once.reply(run, 202)


def _accepted(job: Job) -> tuple[JobView, str]:
    return job.view(), f"/v1/jobs/{job.id}"


def _info(task: TrainedTask) -> TaskInfo:
    return TaskInfo(
        name=task.name,
        module=task.module_name,
        subtasks=tuple(map(subtask_info, task.subtasks)),
        demonstrations=task.demonstrations,
    )
