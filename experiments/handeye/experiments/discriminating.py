"""The MDF tree where most of the input means nothing: Friedman's function with 30 idle inputs, and images.

`python -m handeye.experiments.discriminating --output DIR` writes discriminating.json and discriminating.md; the
committed ones lie in experiments/results/discriminating. Seeds and worlds 0 to 5 were used while building.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import tracemalloc
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.neighbors import KNeighborsRegressor

from handeye.experiments.baselines import k_nearest_neighbours
from handeye.experiments.datasets import friedman
from handeye.experiments.scenes import Floats, Images, render
from handeye.rpt.mdf import MDFTree

SEEDS = (101, 102, 103)
WORLDS = (11, 12, 13)
IMAGES, ASKED = 300, 150
BLOCK = 32
"""px; k-NN sees the means of blocks of this size, as many as the tree does."""


class Result(NamedTuple):
    """One tree beside k-NN."""

    what: str
    seed: int
    unit: str
    error: float
    """Mean over the test samples."""
    theirs: float
    """k-NN's."""
    worst: float
    build: float
    """s"""
    query: float
    """ms, median of single queries, for images with their reduction."""
    memory: float
    """MB, the most that `fit` took beside what it was given; 0 where not measured."""
    false_alarms: float
    """Share of test samples with support of at most 0.05."""


def idle_inputs(seed: int) -> Result:
    """Friedman's function: 5 inputs that matter and 30 that don't, 1000 samples."""
    problem = friedman(seed)
    start = time.perf_counter()
    tree = MDFTree.fit(problem.inputs, problem.outputs)
    build = time.perf_counter() - start
    neighbours = k_nearest_neighbours().fit(problem.inputs, problem.outputs)
    theirs = np.abs(neighbours.predict(problem.test_inputs) - problem.test_outputs)
    return _judge("Friedman, 30 idle inputs", seed, "", tree, problem.test_inputs, problem.test_outputs, theirs, build)


def objects(world: int) -> Result:
    """Where is the bright object? 300 images of 640 x 480 pixels, another larger object moving about too."""
    images, places = render(world, IMAGES, world)
    asked, truth = render(1000 + world, ASKED, world)
    start = time.perf_counter()
    tree = MDFTree.fit(images, places)
    build = time.perf_counter() - start
    tracemalloc.start()
    MDFTree.fit(images, places)
    memory = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    neighbours = KNeighborsRegressor(5, weights="distance").fit(_blocks(images), places)
    theirs = np.linalg.norm(neighbours.predict(_blocks(asked)) - truth, axis=1)
    what = "bright object in images, beside a moving one"
    return _judge(what, world, "px", tree, asked, truth, theirs, build)._replace(memory=memory)


def _judge(
    what: str,
    seed: int,
    unit: str,
    tree: MDFTree,
    asked: Floats | Images,
    truth: Floats,
    theirs: Floats,
    build: float,
) -> Result:
    answer = tree.answer(asked)
    errors = np.linalg.norm(answer.output - truth, axis=1)
    spent = []
    for query in asked[:100]:
        start = time.perf_counter()
        tree.answer(query)
        spent.append(time.perf_counter() - start)
    alarms = float(np.mean(answer.support <= 0.05))
    figures = float(errors.mean()), float(theirs.mean()), float(errors.max())
    return Result(what, seed, unit, *figures, build, 1e3 * float(np.median(spent)), 0.0, alarms)


def _blocks(images: Images) -> Floats:
    """Means of whole blocks, brightness and contrast of each image taken out."""
    n, rows, columns = images.shape
    cells = images.reshape(n, rows // BLOCK, BLOCK, columns // BLOCK, BLOCK).mean(axis=(2, 4), dtype=np.float64)
    flat = cells.reshape(n, -1)
    normal: NDArray[np.float64] = (flat - flat.mean(axis=1, keepdims=True)) / flat.std(axis=1, keepdims=True)
    return normal


def markdown(results: Sequence[Result]) -> str:
    """A row for each tree."""
    lines = [
        "Default settings. k-NN is scikit-learn's with 5 neighbours weighted by 1 / distance: on standardised inputs, "
        f"or on the means of blocks of {BLOCK} px with brightness and contrast taken out.",
        "",
        "| what | seed | mean error | k-NN | ratio | worst | build [s] | query [ms] | memory [MB] | support ≤ 0.05 |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in results:
        cells = [r.what + (f" [{r.unit}]" if r.unit else ""), f"{r.seed}", f"{r.error:.3g}", f"{r.theirs:.3g}"]
        cells += [f"{r.error / r.theirs:.2f}", f"{r.worst:.3g}", f"{r.build:.1f}", f"{r.query:.2f}"]
        cells += [f"{r.memory:.0f}" if r.memory else "", f"{r.false_alarms:.3f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m handeye.experiments.discriminating", description=__doc__)
    parser.add_argument("--seeds", default=",".join(map(str, SEEDS)), help="of Friedman's function, comma-separated")
    parser.add_argument("--worlds", default=",".join(map(str, WORLDS)), help="of the images, comma-separated")
    parser.add_argument("--output", type=Path, required=True, help="directory for the results")
    options = parser.parse_args(arguments)
    results = [idle_inputs(int(seed)) for seed in options.seeds.split(",")]
    results += [objects(int(world)) for world in options.worlds.split(",")]
    options.output.mkdir(parents=True, exist_ok=True)
    content = json.dumps([result._asdict() for result in results], indent=1)
    (options.output / "discriminating.json").write_text(content + "\n")
    (options.output / "discriminating.md").write_text(markdown(results))
    sys.stdout.write(markdown(results))


if __name__ == "__main__":
    main()
