"""Running the taught grasp of the toy world, and what is asked of its end."""

from __future__ import annotations

import numpy as np

from handeye.server.acting import ActingSettings
from handeye.server.results import JobView, RunResult
from handeye.server.settings import ServerSettings
from tests.server.conftest import GRASP, Lab, Part

UNTAUGHT = np.array([233.0, 337.0, 150.0])  # between the taught places
FAR = np.array([100.0, 600.0, 150.0])


def train(lab: Lab, parts: tuple[Part, ...] = GRASP, **settings: object) -> None:
    """Teaches the grasp on a grid of places, in parts; acting settings may be changed."""
    lab.coordinator.settings = ServerSettings(acting=ActingSettings.model_validate(settings))
    lab.teach(lab.places, parts=parts)
    lab.train()
    lab.world.cup = UNTAUGHT
    lab.robot.commands.clear()


def run(lab: Lab, *, one_look: bool = False) -> JobView:
    job = lab.coordinator.run("grasp", "blue cup", one_look=one_look)
    assert job.wait(30.0)
    return job.view()


def done(job: JobView) -> RunResult:
    """What the run did."""
    assert isinstance(job.result, RunResult)
    return job.result


def miss(job: JobView) -> float:
    """Distance of hand and cup in pixels when the gripper has closed: as the first look afterwards saw it."""
    look = done(job).subtasks[1].looks[0]
    return float(np.linalg.norm(np.subtract(look.hand, look.object)))
