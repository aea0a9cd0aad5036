"""What it costs to read an answer: `Model.answer` computes all at once, its properties cut out what is asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from benchmarks.learner.data import GENERATED
from benchmarks.learner.ours import taught
from benchmarks.learner.timing import Timed, in_turns
from handeye.rpt import Answer

SAMPLES = 800
"""As many as the thesis timed."""


class Reading(NamedTuple):
    """µs for one query among 800 samples in 3-D, from Python."""

    answer: float
    """Everything computed, nothing read."""
    output: float
    """And the output read."""
    everything: float
    """And gradient, support, determined, neighbours, distances and weights read too."""
    expected: float
    """And the expected error, which is computed only when read."""


def reading(seed: int, *, rounds: int = 40) -> Reading:
    """Measures in turns."""
    problem = GENERATED["3-D Gaussian"](SAMPLES, seed)
    ask = taught(problem.points).answer

    def everything(answer: Answer) -> object:
        return (
            answer.output, answer.gradient, answer.support, answer.determined,
            answer.ids, answer.distances, answer.weights,
        )  # fmt: skip

    ways: dict[str, Callable[[Any, int], object]] = {
        "answer": lambda query, _k: ask(query),
        "output": lambda query, _k: ask(query).output,
        "everything": lambda query, _k: everything(ask(query)),
        "expected": lambda query, _k: (everything(answer := ask(query)), answer.expected_error),
    }
    queries = list(problem.queries)
    times = in_turns({each: Timed(way, queries) for each, way in ways.items()}, 5, rounds=rounds, calls=100)
    return Reading(**{each: float(np.median(spent)) for each, spent in times.items()})
