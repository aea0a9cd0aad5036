"""How accurately methods learn maps: one table, methods against datasets.

`python -m handeye.experiments.comparison --output DIR` writes comparison.json and comparison.md; the committed ones lie
in experiments/results/comparison.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track

from handeye.experiments.baselines import BASELINES, Estimator
from handeye.experiments.datasets import DATASETS, Dataset, Problem
from handeye.rpt.estimator import RPTRegressor

ESTIMATORS: Mapping[str, Callable[[], Estimator]] = {"RPT (handeye)": RPTRegressor, **BASELINES}
"""By name, what makes a fresh estimator with its default settings."""

SEEDS = range(101, 104)
SPLITS = range(101, 111)
"""Seeds for recorded data."""

LIBRARIES = ("numpy", "numba", "scipy", "scikit-learn")


class Score(NamedTuple):
    """One estimator on one problem. Errors are Euclidean distances between answer and truth, in the dataset's unit."""

    dataset: str
    unit: str
    estimator: str
    seed: int
    mean: float
    rms: float
    p95: float
    """95 of 100 errors are smaller."""
    fit_seconds: float


def compare(
    estimators: Mapping[str, Callable[[], Estimator]], datasets: Mapping[str, Dataset], seeds: Iterable[int]
) -> tuple[list[Score], dict[str, str]]:
    """Fits and tests every estimator on every dataset with every seed; one message for each dataset that is absent."""
    scores: list[Score] = []
    absent: dict[str, str] = {}
    rounds = [(seed, name) for seed in seeds for name in datasets]
    for seed, name in track(rounds, "comparing", console=Console(stderr=True), transient=True):
        dataset = datasets[name]
        try:
            problem = dataset.draw(seed)
        except FileNotFoundError as missing:
            absent[name] = str(missing)
            continue
        for label, make in estimators.items():
            errors, seconds = evaluate(_seeded(make(), seed), problem)
            errors = errors * dataset.scale
            spread = float(np.sqrt(np.mean(errors**2))), float(np.quantile(errors, 0.95))
            scores.append(Score(name, dataset.unit, label, seed, float(errors.mean()), *spread, seconds))
    return scores, absent


def evaluate(estimator: Estimator, problem: Problem) -> tuple[np.ndarray[tuple[int], np.dtype[np.float64]], float]:
    """Fits, then answers the test: the errors (q,), Euclidean, in the outputs' unit; and how long the fit took [s]."""
    start = time.perf_counter()
    estimator.fit(problem.inputs, problem.outputs)
    seconds = time.perf_counter() - start
    answers = np.asarray(estimator.predict(problem.test_inputs), dtype=np.float64).reshape(problem.test_outputs.shape)
    return np.linalg.norm(answers - problem.test_outputs, axis=1), seconds


def write(scores: Sequence[Score], absent: Mapping[str, str], directory: Path) -> None:
    """Writes comparison.json and comparison.md into the directory."""
    directory.mkdir(parents=True, exist_ok=True)
    versions = {library: version(library) for library in LIBRARIES}
    content = {"versions": versions, "absent": sorted(absent), "scores": [score._asdict() for score in scores]}
    (directory / "comparison.json").write_text(json.dumps(content, indent=1) + "\n")
    (directory / "comparison.md").write_text(markdown(scores, absent))


def markdown(scores: Sequence[Score], absent: Mapping[str, str]) -> str:
    """The tables of mean error and of the time to fit: a row for each dataset, a column for each estimator."""
    seeds = {
        score.dataset: tuple(dict.fromkeys(s.seed for s in scores if s.dataset == score.dataset)) for score in scores
    }
    usual = next(iter(seeds.values()), ())
    others = list(dict.fromkeys(its for its in seeds.values() if its != usual))
    special = [f"{_listed(its)} for {' and '.join(name for name in seeds if seeds[name] == its)}" for its in others]
    lines = [
        f"Seeds {'; '.join([_listed(usual), *special])}.",
        "",
        "## Mean error",
        "",
        "Euclidean distance between answer and truth, mean over the test samples; ± standard deviation over the seeds.",
        "",
        *_table(scores, lambda score: score.mean, _with_spread),
        "",
        "## Time to fit",
        "",
        "Seconds, median over the seeds: a first fit may include compilation.",
        "",
        *_table(scores, lambda score: score.fit_seconds, lambda values: f"{np.median(values):.2g}"),
    ]
    if absent:
        lines += ["", f"Left out, its data being absent: {'; '.join(absent)}."]
    return "\n".join(lines) + "\n"


def _table(
    scores: Sequence[Score],
    figure: Callable[[Score], float],
    cell: Callable[[np.ndarray[tuple[int], np.dtype[np.float64]]], str],
) -> list[str]:
    """Lines of a table whose cells are made of one figure of all seeds."""
    estimators = list(dict.fromkeys(score.estimator for score in scores))
    lines = [f"| dataset | {' | '.join(estimators)} |", "|---" * (1 + len(estimators)) + "|"]
    for dataset, unit in dict.fromkeys((score.dataset, score.unit) for score in scores):
        cells = [f"{dataset} [{unit}]" if unit else dataset]
        for estimator in estimators:
            same = [score for score in scores if (score.dataset, score.estimator) == (dataset, estimator)]
            cells.append(cell(np.array([figure(score) for score in same])))
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _with_spread(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> str:
    """Mean ± standard deviation with about three significant digits."""
    mean, spread = values.mean(), values.std()
    if 0 < mean < 1e-3:
        return f"{mean:.2g} ± {spread:.1g}"
    digits = int(np.clip(2 - np.floor(np.log10(mean)), 0, 5)) if mean > 0 else 0
    return f"{mean:.{digits}f} ± {spread:.{digits}f}"


def _seeded(estimator: Estimator, seed: int) -> Estimator:
    """The estimator with each of its random states, its steps' among them, set to the seed."""
    names = [name for name in estimator.get_params() if name.split("__")[-1] == "random_state"]
    return estimator.set_params(**dict.fromkeys(names, seed))


def _listed(seeds: Iterable[int]) -> str:
    return ",".join(map(str, seeds))


def main(arguments: Sequence[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m handeye.experiments.comparison", description=__doc__)
    parser.add_argument("--seeds", default=_listed(SEEDS), help="comma-separated; 1 and 2 chose the methods' settings")
    parser.add_argument("--splits", default=_listed(SPLITS), help="the same for recorded data, which they only split")
    parser.add_argument("--output", type=Path, required=True, help="directory for comparison.json and comparison.md")
    options = parser.parse_args(arguments)
    chosen = {}
    for name in ("seeds", "splits"):
        try:
            chosen[name] = [int(seed) for seed in getattr(options, name).split(",")]
        except ValueError:
            parser.error(f"--{name} takes integers with commas between them, not {getattr(options, name)!r}")
    scores: list[Score] = []
    absent: dict[str, str] = {}
    for name, dataset in DATASETS.items():
        found, missing = compare(ESTIMATORS, {name: dataset}, chosen["splits" if dataset.recorded else "seeds"])
        scores += found
        absent |= missing
    for message in dict.fromkeys(absent.values()):
        sys.stderr.write(f"skipped: {message}\n")
    write(scores, absent, options.output)
    sys.stdout.write(markdown(scores, absent))


if __name__ == "__main__":
    main()
