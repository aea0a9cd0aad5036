"""Settings and scales chosen from the data: which of a few candidates answers best for samples that are left out.

The error of a candidate is the mean length of left-out residuals, each output divided by its standard deviation (and
all by sqrt M), so that 1 is no better than answering with the mean. Candidates are tried one coordinate at a time, from
the best of a coarse grid: about thirty of them. The same data in the same order give the same choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from handeye.rpt.calibration import ask_left_out
from handeye.rpt.region import TANGENTS, rule_for
from handeye.rpt.scaling import candidate_scales, spread
from handeye.rpt.settings import Method, Settings
from handeye.rpt.tree import Tree, build

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

SAMPLES = 10_000
"""Where there are more samples, the choice goes by so many of them, evenly spread over the order in which they came."""
ASKED = 256
"""So many samples at most are left out and asked for ..."""
WORK = 3e7
"""... fewer where a local fit is costly: about so many operations for all fits of a candidate together."""
FEWEST = 48
"""But never fewer, where there are as many."""

ANSWER = 5e5
"""Operations; local functions that cost more for each answer are not tried: no quadratic ones from 11 inputs on, no
linear ones from about 61 on, where KNDB alone is left."""

COARSE = (2.0, 7.0)
"""Neighbours for each term of a local function: first ..."""
FINE = (1.5, 2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 25.0)
"""... and then."""
KNDB_NEIGHBOURS = (1, 3, 5, 8, 12, 20)

Step = dict[str, Any]
"""Settings that change."""


class Fixed(NamedTuple):
    """What the user has decided; the data decide what is None."""

    method: Method | None = None
    neighbours: int | None = None
    smoothing: float | None = None
    scales: Floats | None = None
    """(N,)"""


class Trial(NamedTuple):
    """A candidate and how it did."""

    scaling: str
    settings: Settings
    error: float


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """What was chosen, and from what."""

    settings: Settings
    scales: Floats
    """(N,)"""
    trials: tuple[Trial, ...]
    """Best first; empty where there were too few samples to leave any out."""

    def __str__(self) -> str:
        """The candidates as a table."""
        lines = ["   error  scaling      method           neighbours  smoothing   ridges"]
        for scaling, s, error in self.trials:
            k = "all" if s.neighbours is None else s.neighbours
            ridges = f"{s.ridge:.0e} {s.curvature_ridge:.0e}"
            lines.append(f"{error:8.4g}  {scaling:11}  {s.method:15}  {k:>10}  {s.smoothing:9g}   {ridges}")
        return "\n".join(lines)


class Part(NamedTuple):
    """Samples of one category: inputs without categories (n, d), outputs (n, p), groups (n,)."""

    inputs: Floats
    outputs: Floats
    groups: Integers


def select(inputs: Floats, outputs: Floats, groups: Integers, categorical: Sequence[int], fixed: Fixed) -> Selection:
    """Chooses settings and scales for samples: inputs (n, N), outputs (n, M), groups (n,)."""
    chosen = np.unique(np.linspace(0, len(inputs) - 1, min(len(inputs), SAMPLES)).astype(int))
    inputs, outputs, groups = inputs[chosen], outputs[chosen], groups[chosen]
    free = np.ones(inputs.shape[1], np.bool_)
    free[list(categorical)] = False
    _, category = np.unique(inputs[:, ~free], axis=0, return_inverse=True)
    category = category.reshape(-1)
    by_name = {"given": fixed.scales[free]} if fixed.scales is not None else None
    by_name = by_name or candidate_scales(inputs[:, free], outputs, category)
    order = [np.flatnonzero(category == c) for c in range(category.max() + 1)]
    parts = [Part(inputs[np.ix_(mine, free)], outputs[mine], groups[mine]) for mine in order]
    trials = Search(parts, outputs, by_name).run(fixed)
    settings = trials[0].settings if trials else replace(Settings(), **_fixed_steps(fixed))
    scales = np.ones(len(free))
    scales[free] = by_name[trials[0].scaling] if trials else next(iter(by_name.values()))
    return Selection(settings, scales, trials)


class Search:
    """Tries candidates, each once."""

    def __init__(self, parts: Sequence[Part], outputs: Floats, scales: dict[str, Floats]) -> None:
        """Parts of the samples, all their outputs (n, p), and scales (d,) by name."""
        self._parts = [part for part in parts if len(part.inputs) > 1]
        self._scales = scales
        self._units = spread(outputs) * np.sqrt(outputs.shape[1])
        self._most = max((len(part.inputs) for part in self._parts), default=1) - 1
        self._trees: dict[str, list[Tree]] = {}
        self._tried: dict[tuple[str, Settings], Trial] = {}
        self._ask = ASKED

    def run(self, fixed: Fixed) -> tuple[Trial, ...]:
        """All trials, best first."""
        if not self._parts:
            return ()
        d = self._parts[0].inputs.shape[1]
        methods = [fixed.method] if fixed.method else _methods(self._most, d)
        self._ask = min(_affordable(method, d) for method in methods)
        base = replace(Settings(), **_fixed_steps(fixed))
        for method in methods:
            for step in _neighbours(method, d, COARSE, fixed):
                for scaling in self._scales:
                    self._try(scaling, replace(base, **_start(method, fixed), **step, method=method))
        best = self._best()
        for steps in _coordinates(best.settings.method, d, fixed):
            for step in steps:
                self._try(best.scaling, replace(best.settings, **step))
            best = self._best()
            for scaling in self._scales:
                self._try(scaling, best.settings)
            best = self._best()
        return tuple(sorted(self._tried.values(), key=lambda trial: trial.error))

    def _best(self) -> Trial:
        return min(self._tried.values(), key=lambda trial: trial.error)

    def _try(self, scaling: str, settings: Settings) -> None:
        # With more neighbours than there are samples, all are taken.
        key = scaling, replace(settings, neighbours=min(settings.neighbours or self._most, self._most))
        if key not in self._tried:
            self._tried[key] = Trial(scaling, settings, self._error(scaling, settings))

    def _error(self, scaling: str, settings: Settings) -> float:
        factors = 1 / self._scales[scaling]
        if scaling not in self._trees:
            self._trees[scaling] = [build(part.inputs * factors) for part in self._parts]
        total = sum(len(part.inputs) for part in self._parts)
        lengths = []
        for part, tree in zip(self._parts, self._trees[scaling], strict=True):
            n, p = part.outputs.shape
            rule = rule_for(settings, p, n, n, factors)
            knowledge, rows = part.outputs, np.zeros(0, np.int64)
            if settings.method in TANGENTS:
                # Gradients are estimated for each left-out sample anew.
                knowledge, rows = np.zeros((n, p + p * len(factors) + 2)), np.arange(n)
                knowledge[:, :p] = part.outputs
            ask = max(1, round(self._ask * n / total))
            residuals = ask_left_out(tree, knowledge, rows, part.groups, rule, ask).residuals
            with np.errstate(over="ignore", invalid="ignore"):
                lengths.append(np.sqrt(np.sum((residuals / self._units) ** 2, axis=1)))
        # A fit may be wild where a sample lies far from all others.
        error = float(np.mean(np.concatenate(lengths))) if any(map(len, lengths)) else np.inf
        return error if np.isfinite(error) else np.inf


def _methods(n: int, d: int) -> list[Method]:
    """What is worth trying where n samples of d components may answer. The first wins where errors are equal."""
    local: tuple[Method, ...] = ("local_linear", "local_quadratic")
    methods = [method for method in local if _answer_work(method, d, COARSE[0]) <= ANSWER]
    if FINE[0] * _terms("local_quadratic", d) > n:
        methods = methods[:1]
    return [*methods, "kndb"]


def _terms(method: Method, d: int) -> int:
    return 1 + d + (d * (d + 1) // 2 if method == "local_quadratic" else 0)


def _answer_work(method: Method, d: int, share: float) -> float:
    """Operations for one local fit to `share` neighbours for each term."""
    return share * _terms(method, d) ** 3 / 2


def _affordable(method: Method, d: int) -> int:
    """How many left-out samples are asked for."""
    fits = 5 if method == "kndb2" else 1
    return int(np.clip(WORK / (fits * _answer_work(method, d, FINE[3])), FEWEST, ASKED))


def _start(method: Method, fixed: Fixed) -> Step:
    return {"smoothing": 0.3} if fixed.smoothing is None and method.startswith("local") else {}


def _fixed_steps(fixed: Fixed) -> Step:
    steps = {"method": fixed.method, "neighbours": fixed.neighbours, "smoothing": fixed.smoothing}
    return {name: value for name, value in steps.items() if value is not None}


def _neighbours(method: Method, d: int, shares: Sequence[float], fixed: Fixed) -> list[Step]:
    """Numbers of neighbours, where they are not fixed and play a part."""
    if fixed.neighbours is not None or method in ("nearest", "leaf_map"):
        return [{}]
    if method.startswith("kndb"):
        return [{"neighbours": k} for k in (KNDB_NEIGHBOURS if shares is FINE else (5,))]
    affordable = [share for share in shares if _answer_work(method, d, share) <= ANSWER] or shares[:1]
    return [{"neighbours": int(np.ceil(share * _terms(method, d)))} for share in affordable]


def _coordinates(method: Method, d: int, fixed: Fixed) -> list[list[Step]]:
    """What is varied, one coordinate after the other, the neighbours twice."""
    neighbours = _neighbours(method, d, FINE, fixed)
    smoothing: list[Step] = [{"smoothing": value} for value in (0.1, 0.3, 1.0)] if fixed.smoothing is None else []
    ridges: list[Step] = [{"ridge": 1e-4, "curvature_ridge": 1e-2}, {"ridge": 1e-8, "curvature_ridge": 1e-6}]
    alphas: list[Step] = [{"alpha": value} for value in (1.2, 3.0, 10.0)]
    return {
        "nearest": [],
        "kndb": [neighbours, alphas, neighbours],
        "kndb2": [neighbours, alphas, smoothing, ridges, neighbours],
        "leaf_map": [ridges],
    }.get(method, [neighbours, smoothing, ridges, neighbours])
