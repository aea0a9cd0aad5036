"""Near-neighbour search: the learner and what people would pick, side by side, in one run.

    python -m benchmarks.learner.run

One thread, k = 5. Sets: 3-D and 6-D Gaussian, 6-D manifolds in 11-D and 16-D, and the lab's recorded grasp. Measured:
one query per call from Python, many per call, construction, memory, recall; of the learner alone insertion, growth of
cost with n, a second thread, the first answer of a fresh process. The systems take turns, so that whatever else the
machine does hits all of them. Prints the tables; writes results.json, results.md, results.png and batches.png.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from rich.console import Console

from benchmarks.learner import threads
from benchmarks.learner.cold import cold
from benchmarks.learner.data import GENERATED, Problem, lab
from benchmarks.learner.growth import SIZES as GROWING
from benchmarks.learner.growth import growth
from benchmarks.learner.insertion import insertion
from benchmarks.learner.measure import measure
from benchmarks.learner.reading import SAMPLES, reading
from benchmarks.learner.report import show, write
from benchmarks.learner.targets import Findings

SEED = 31
"""Of the reported figures; whatever is chosen by looking at figures is chosen with other seeds (7)."""
SIZES = (100, 800, 1_000, 10_000, 100_000, 1_000_000)
RECORDED = "lab grasp, 9-D"
FLATTEST, WIDEST = "3-D Gaussian", "6-D manifold in 16-D"
NEEDED = ("pykdtree", "hnswlib", "faiss")
MODELS_GROWN = (800, 10_000)
"""Points to which models insert more, in all sets: each new sample changes gradients of old ones."""
TREES_GROWN = (800, 10_000, 100_000, 1_000_000)
TWO_AT = {threads.EXACT: 100_000, threads.ANSWERS: 10_000}

Step = tuple[str, Callable[[], None]]


def main() -> None:
    """Measures, prints and writes."""
    missing = [each for each in NEEDED if importlib.util.find_spec(each) is None]
    if missing:
        sys.exit(
            f"not installed: {', '.join(missing)}. `make bench` installs them; by hand (hnswlib needs g++):\n"
            f"    {sys.executable} -m pip install --require-hashes -r requirements-bench.txt"
        )
    names = [*GENERATED, RECORDED]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=_numbers, default=list(SIZES), help="of the generated sets: 100,1000,...")
    parser.add_argument("--sets", nargs="+", choices=names, default=names)
    parser.add_argument(
        "--largest-slow", type=int, default=100_000, help="points; graphs and models of more take minutes to build"
    )
    parser.add_argument(
        "--seed", type=int, default=SEED, help="of the data; choose settings with another than the reports'"
    )
    parser.add_argument("--output", type=Path, default=Path("report/learner"), help="directory of the results")
    arguments = parser.parse_args()
    found = run(arguments.sets, arguments.sizes, arguments.seed, largest_slow=arguments.largest_slow)
    write(found, arguments.output, arguments.seed)
    show(found)
    print(f"written: {arguments.output}")


def run(names: list[str], sizes: list[int], seed: int, *, largest_slow: int) -> Findings:
    """Everything on these sets, nothing with more points than the largest of the sizes."""
    found = Findings()
    generated = [name for name in names if name in GENERATED]
    steps = [
        *_systems(found, names, sizes, seed, largest_slow),
        *_growth(found, generated, [n for n in GROWING if n <= max(sizes)], seed),
        *_insertions(found, names, max(sizes), seed),
        *_two(found, generated, max(sizes), seed),
        *_alone(found, generated, sizes, seed),
    ]
    console, begin = Console(stderr=True, highlight=False, markup=False), time.monotonic()
    for number, (what, step) in enumerate(steps, 1):
        console.print(f"{time.monotonic() - begin:5.0f} s  {number}/{len(steps)}  {what}")
        step()
    console.print(f"{time.monotonic() - begin:5.0f} s  done")
    return found


def _systems(found: Findings, names: list[str], sizes: list[int], seed: int, largest_slow: int) -> Iterator[Step]:
    def step(name: str, make: Callable[[], Problem]) -> None:
        problem = make()
        found.results += measure(name, problem, slow=len(problem.points) <= largest_slow)

    for name in names:
        if name == RECORDED:
            yield f"all systems, {name}", partial(step, name, lab)
        else:
            for n in sizes:
                yield f"all systems, {name}, {n} points", partial(step, name, partial(GENERATED[name], n, seed))


def _growth(found: Findings, names: list[str], sizes: list[int], seed: int) -> Iterator[Step]:
    def step(name: str) -> None:
        found.growth += growth(name, seed, sizes)

    for name in names if len(sizes) > 2 else []:
        yield f"growth, {name}", partial(step, name)


def _insertions(found: Findings, names: list[str], largest: int, seed: int) -> Iterator[Step]:
    def step(name: str, n: int, model: bool) -> None:
        found.insertions.append(insertion(name, n, seed, model=model))

    for model, grown in ((False, TREES_GROWN), (True, MODELS_GROWN)):
        for name in names:
            # The recorded set has the size it has.
            for n in (0,) if name == RECORDED else [n for n in grown if n <= largest]:
                what = "Model.learn" if model else "Tree.insert"
                yield f"{what}, {name}, {n or 'all'} points", partial(step, name, n, model)


def _two(found: Findings, names: list[str], largest: int, seed: int) -> Iterator[Step]:
    def step(name: str, n: int, what: str) -> None:
        found.two.append(threads.two(name, n, seed, what))

    for what, n in TWO_AT.items():
        for name in names:
            if name in (FLATTEST, WIDEST):
                yield f"two at once, {what}, {name}", partial(step, name, min(n, largest), what)


def _alone(found: Findings, names: list[str], sizes: list[int], seed: int) -> Iterator[Step]:
    def read() -> None:
        found.reading = reading(seed)

    def start() -> None:
        found.cold = cold()

    if FLATTEST in names and SAMPLES in sizes:
        yield "reading an answer", read
        yield "a fresh process", start


def _numbers(text: str) -> list[int]:
    return [int(part) for part in text.split(",")]


if __name__ == "__main__":
    main()
