"""Pouring as in the thesis's Table 4.2: five subtasks, ten demonstrations, liquid from the cup into the jar."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from handeye.simulation.evaluation.outcome import Figure, average, share
from handeye.simulation.evaluation.site import Evaluation, Site, Trial
from handeye.simulation.evaluation.tasks import TAUGHT, Table
from handeye.simulation.lessons import pour
from handeye.simulation.liquid import PARTICLES
from handeye.simulation.objects import CUPS, JAR
from handeye.simulation.scene import WorldState
from handeye.simulation.scoring_two import POUR_SUBTASKS, score_pour

_CUP = CUPS["blue cup"]
_THESIS = {"approach": "100 %", "grasp": "100 %", "delivery": "100 %", "pour": "80 %", "replace": "100 %"}


def _judge(states: Sequence[WorldState], ended: dict[str, float]) -> dict[str, Any]:
    found = score_pour(states, _CUP, JAR, ended)
    shares = {"arrived": found.arrived, "left": found.left, "spilled": found.spilled}
    return {"passed": dict(found.passed), **shares}


def _fill(site: Site) -> None:
    site.lab.fill(_CUP.name, PARTICLES)


def _figures(trials: Sequence[Trial]) -> tuple[Figure, ...]:
    return (
        share(
            f"all five subtasks passed, {TAUGHT} demonstrations",
            [all(each["passed"].values()) for each in trials],
            95.0,
        ),
        *(share(name, [each["passed"][name] for each in trials], None, _THESIS[name]) for name in POUR_SUBTASKS),
        average("liquid that arrives", [100 * each["arrived"] for each in trials], "%", least=95.0),
        average("liquid that is spilled", [100 * each["spilled"] for each in trials], "%"),
        average("looks", [sum(each["looks"].values()) for each in trials], "looks"),
    )


def _histograms(trials: Sequence[Trial]) -> dict[str, tuple[float, ...]]:
    return {"Liquid that does not arrive, in % of it": tuple(100 * (1 - each["arrived"]) for each in trials)}


EVALUATION = Evaluation(
    "pour",
    "Pouring (Table 4.2): taught by demonstrations, at places never shown",
    Table(pour(_CUP), _judge, _fill).measure,
    _figures,
    _histograms,
)
