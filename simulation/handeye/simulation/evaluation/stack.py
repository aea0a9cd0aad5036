"""A task that was not in the thesis, nor in the code when the executor was written: a cup is put on a stand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from handeye.simulation.evaluation.outcome import Figure, average, share
from handeye.simulation.evaluation.site import Evaluation, Trial
from handeye.simulation.evaluation.tasks import TAUGHT, Table
from handeye.simulation.lessons import stack
from handeye.simulation.objects import CUPS, STAND
from handeye.simulation.scene import WorldState
from handeye.simulation.scoring_two import STACK_SUBTASKS, score_stack

_CUP = CUPS["blue cup"]


def _judge(states: Sequence[WorldState], ended: dict[str, float]) -> dict[str, Any]:
    cup, stand = (states[-1].object(name).pose.position for name in (_CUP.name, STAND.name))
    off = 1e3 * float(((cup - stand)[:2] ** 2).sum() ** 0.5)
    return {"passed": score_stack(states, _CUP, STAND, ended), "off_mm": off}


def _figures(trials: Sequence[Trial]) -> tuple[Figure, ...]:
    put = [each["off_mm"] for each in trials if each["passed"]["put"]]
    return (
        share(f"all four subtasks passed, {TAUGHT} demonstrations", [all(each["passed"].values()) for each in trials]),
        *(share(name, [each["passed"][name] for each in trials]) for name in STACK_SUBTASKS),
        *([average("cup beside the middle of the stand", put, "mm")] if put else []),
        average("looks", [sum(each["looks"].values()) for each in trials], "looks"),
    )


def _histograms(trials: Sequence[Trial]) -> dict[str, tuple[float, ...]]:
    return {"Cup beside the middle of the stand, in mm": tuple(each["off_mm"] for each in trials)}


EVALUATION = Evaluation(
    "stack",
    "Putting a cup on a stand: taught by demonstrations, at places never shown",
    Table(stack(_CUP), _judge).measure,
    _figures,
    _histograms,
)
