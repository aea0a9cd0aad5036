"""Do support and expected errors keep their promises? False alarms, power and coverage on demonstrations never shown.

`python -m handeye.experiments.trust --seeds 101,102,103 --output DIR` writes trust.json and trust.md.

A seed decides which demonstrations are taught and which are asked. Nothing was tuned: limits and coverage are the
library's own.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handeye.experiments.datasets import BOARD_VIEWS, Floats, corners, simulated_stereo
from handeye.rpt import Model, Settings

Integers = NDArray[np.int64]

LEVELS = (0.02, 0.05, 0.1)
"""Limits of support at which false alarms are counted; power at the middle one."""
STRETCHES = (1.5, 2.0, 3.0)
"""A query leaves the taught region: it is moved away from the middle of its category until it lies so many times as far
from it as the farthest taught sample in its direction lies."""
GRASP = Path(__file__).resolve().parents[3] / "benchmarks" / "data" / "lab_grasp.npz"
GRASP_SCALES = (1.0, 30.0, 30.0, 10.0, 0.15, 0.15, 0.15, 0.15, 0.15, 0.15)
"""Subtask (a category), px, px, px, then rad, as module IJS declares them."""


class Lesson(NamedTuple):
    """What is taught and what is asked: inputs (n, d), outputs (n, p), demonstrations (n,) or None."""

    inputs: Floats
    outputs: Floats
    groups: Integers | None
    asked_inputs: Floats
    asked_outputs: Floats
    scales: Floats
    categorical: tuple[int, ...]


class Record(NamedTuple):
    """What one seed gave on one dataset."""

    dataset: str
    seed: int
    taught: int
    asked: int
    false_alarms: tuple[float, ...]
    """Share of ordinary queries whose support is at or below each of LEVELS."""
    power: tuple[float, ...]
    """Share of queries at each of STRETCHES whose support is at or below the middle of LEVELS."""
    coverage: float
    """Share of the ordinary answers' components whose error is at most the expected one; 0.9 is promised."""


def grasp(seed: int) -> Lesson:
    """The grasp recorded in the lab: 20 of 30 demonstrations are taught, the others asked."""
    with np.load(GRASP, allow_pickle=False) as stored:
        demonstration = stored["demonstration"].astype(np.int64)
        inputs = np.column_stack([stored["subtask"].astype(np.float64), stored["inputs"]])
        outputs = np.asarray(stored["outputs"])
    return _split(inputs, outputs, demonstration, 20, seed, np.array(GRASP_SCALES), (0,))


def chessboard(seed: int) -> Lesson:
    """The real stereo pairs: 22 of 29 views of the board are taught, the others asked."""
    inputs, outputs, views = corners()
    return _split(inputs, outputs, views, BOARD_VIEWS, seed, inputs.std(axis=0), ())


def stereo(seed: int) -> Lesson:
    """The thesis's simulated stereo (Fig 4.4, rounded pixels): 800 samples, each on its own, and 1000 others."""
    problem = simulated_stereo(seed, noisy=True)
    scales = problem.inputs.std(axis=0)
    return Lesson(problem.inputs, problem.outputs, None, problem.test_inputs, problem.test_outputs, scales, ())


DATASETS: dict[str, Callable[[int], Lesson]] = {
    "recorded grasp, by demonstrations": grasp,
    "real stereo, by views": chessboard,
    "stereo in simulation, by samples": stereo,
}


def judge(name: str, lesson: Lesson, seed: int) -> Record:
    """Teaches, asks, counts."""
    d, p = lesson.inputs.shape[1], lesson.outputs.shape[1]
    settings = Settings("local_quadratic", neighbours=40)
    model = Model(d, p, settings, scales=lesson.scales, categorical=lesson.categorical)
    model.learn(lesson.inputs, lesson.outputs, groups=lesson.groups)
    ordinary = model.answers(lesson.asked_inputs)
    errors = np.abs(ordinary.output - lesson.asked_outputs)
    away = [model.answers(stretched(lesson, stretch)).support for stretch in STRETCHES]
    return Record(
        name,
        seed,
        len(lesson.inputs),
        len(lesson.asked_inputs),
        tuple(float(np.mean(ordinary.support <= level)) for level in LEVELS),
        tuple(float(np.mean(support <= LEVELS[1])) for support in away),
        float(np.mean(errors <= ordinary.expected_error)),
    )


def stretched(lesson: Lesson, stretch: float) -> Floats:
    """The queries, moved straight away from the middle of their category's samples (`STRETCHES`)."""
    free = [i for i in range(lesson.inputs.shape[1]) if i not in lesson.categorical]
    names, moved = lesson.asked_inputs[:, list(lesson.categorical)], lesson.asked_inputs.copy()
    for category in np.unique(names, axis=0):
        mine = np.all(names == category, axis=1)
        taught = lesson.inputs[np.all(lesson.inputs[:, list(lesson.categorical)] == category, axis=1)][:, free]
        middle, scales = taught.mean(axis=0), lesson.scales[free]
        reach = (taught - middle) / scales
        ways = (lesson.asked_inputs[mine][:, free] - middle) / scales
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        farthest = (ways @ reach.T).max(axis=1, keepdims=True)
        moved[np.ix_(mine, free)] = middle + stretch * farthest * ways * scales
    return moved


def markdown(records: Sequence[Record]) -> str:
    """A row for each dataset: means over the seeds, with the range."""
    levels, stretches = [f"false alarms at {level:g}" for level in LEVELS], [f"power at {s:g} x" for s in STRETCHES]
    lines = [
        f"Seeds {', '.join(str(seed) for seed in dict.fromkeys(r.seed for r in records))}. Power is the share of "
        f"queries outside with support of at most {LEVELS[1]:g}; coverage is promised to be 0.9.",
        "",
        "| dataset | taught | asked | " + " | ".join([*levels, *stretches, "coverage"]) + " |",
        "|---" * (4 + len(LEVELS) + len(STRETCHES)) + "|",
    ]
    for name in dict.fromkeys(record.dataset for record in records):
        mine = [record for record in records if record.dataset == name]
        figures = np.array([[*r.false_alarms, *r.power, r.coverage] for r in mine])
        cells = [_spread(column) for column in figures.T]
        counts = [f"{np.mean([r.taught for r in mine]):.0f}", f"{np.mean([r.asked for r in mine]):.0f}"]
        lines.append(f"| {' | '.join([name, *counts, *cells])} |")
    return "\n".join(lines) + "\n"


def _spread(values: Floats) -> str:
    return f"{values.mean():.3f} ({values.min():.3f} to {values.max():.3f})"


def _split(
    inputs: Floats,
    outputs: Floats,
    groups: Integers,
    taught: int,
    seed: int,
    scales: Floats,
    categorical: tuple[int, ...],
) -> Lesson:
    chosen = np.random.default_rng(seed).permutation(np.unique(groups))[:taught]
    mine = np.isin(groups, chosen)
    return Lesson(inputs[mine], outputs[mine], groups[mine], inputs[~mine], outputs[~mine], scales, categorical)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m handeye.experiments.trust", description=__doc__)
    parser.add_argument("--seeds", default="101,102,103,104,105,106,107,108,109,110", help="comma-separated")
    parser.add_argument("--output", type=Path, required=True, help="directory for trust.json and trust.md")
    options = parser.parse_args(arguments)
    records = []
    for name, draw in DATASETS.items():
        for seed in map(int, options.seeds.split(",")):
            try:
                records.append(judge(name, draw(seed), seed))
            except FileNotFoundError as missing:
                sys.stderr.write(f"skipped: {missing}\n")
                break
    options.output.mkdir(parents=True, exist_ok=True)
    (options.output / "trust.json").write_text(json.dumps([r._asdict() for r in records], indent=1) + "\n")
    (options.output / "trust.md").write_text(markdown(records))
    sys.stdout.write(markdown(records))


if __name__ == "__main__":
    main()
