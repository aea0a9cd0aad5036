"""Teaching the toy world's hand-eye chain: what the tests of it share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from handeye.modules import css
from handeye.server.results import CollectResult, JobView
from handeye.server.schemas.coordination import PosturesRequest

if TYPE_CHECKING:
    from handeye.server.job import Job
    from tests.server.conftest import Lab

MIDDLE = np.array([23.5, 31.5])  # of the toy's pictures
REGION: dict[str, Any] = {"lower": (0.5, -0.3, 0.2), "upper": (0.8, 0.0, 0.44)}
SYNERGIES = tuple(tuple(map(float, row)) for row in np.eye(6)[:3])


def view(job: Job) -> JobView:
    assert job.wait(120.0)
    return job.view()


def succeeded(job: Job) -> JobView:
    told = view(job)
    assert told.error is None, told.error
    return told


def show_cup(lab: Lab) -> None:
    lab.coordinator.show_object("blue cup", "backgrounds", 0.0)
    lab.coordinator.show_object("blue cup", "examples", 0.0)


def fixate(lab: Lab, count: int) -> None:
    """From so many poses of the head, each with the cup elsewhere."""
    random = np.random.default_rng(3)
    show_cup(lab)
    for _ in range(count):
        lab.world.cup = np.array([*random.uniform((100.0, 200.0), (300.0, 440.0)), random.uniform(120.0, 180.0)])
        lab.world.head = (0.0, float(random.uniform(-0.15, 0.15)))
        succeeded(lab.coordinator.coordination.collect_fixation("blue cup", "all"))


def teach_css(lab: Lab) -> None:
    """As a camera that measures everything in thousands of px."""
    random = np.random.default_rng(4)
    seen = np.column_stack(
        [random.uniform(-400, 700, 3000), random.uniform(-400, 800, 3000), random.uniform(50, 250, 3000)]
    )
    lab.coordinator.modules.create(css.DECLARATION)
    lab.coordinator.modules.add("CSS", seen, seen / 1000.0, [None] * len(seen))


def collect(lab: Lab, *modules: str, postures: int = 60, **options: Any) -> CollectResult:
    request = {"modules": modules, "postures": postures, "synergies": SYNERGIES, **REGION, **options}
    told = succeeded(lab.coordinator.coordination.collect_postures(PosturesRequest.model_validate(request)))
    assert isinstance(told.result, CollectResult)
    return told.result


def able(lab: Lab) -> None:
    """Everything that reaching needs."""
    fixate(lab, 8)
    teach_css(lab)
    lab.world.head = (-0.35, -0.3)
    collect(lab, "AJS", "CAS", postures=120)
    lab.world.head = (-0.35, -0.3)
