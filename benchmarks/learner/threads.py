"""What a second thread adds to batches, beside what a second process adds: the machine gives no more than that.

python -m benchmarks.learner.threads SET N SEED WHAT COUNT   one of two processes; told by its input when to begin
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import NamedTuple

import numpy as np

from benchmarks.learner.data import GENERATED, ROOT
from benchmarks.learner.ours import taught
from handeye.rpt import build

K = 5
EXACT, ANSWERS = "Tree.exact", "Model.answers"
BATCH = 0.2
"""s, about, that one batch takes: starting a thread, or telling a process, is nothing beside it."""
ROUNDS = 15
END = 60.0
"""s; a process that was told to end and has not by then is killed."""


class Two(NamedTuple):
    """Throughput of two at once, in times that of one alone: medians of the rounds."""

    points: str
    n: int
    what: str
    threads: float
    processes: float


def two(name: str, n: int, seed: int, what: str, *, rounds: int = ROUNDS, batch: float = BATCH) -> Two:
    """One batch alone, two in threads, two in processes, in turns."""
    trial = _task(name, n, seed, what, 1000)
    trial()
    count = max(100, int(1000 * batch / _seconds(trial)))
    task = _task(name, n, seed, what, count)
    threads, processes = [], []
    with ExitStack() as stack:
        workers = [stack.enter_context(_process(name, n, seed, what, count)) for _ in range(2)]
        for _ in range(rounds):
            alone = _seconds(task)
            threads.append(2 * alone / _seconds(lambda: _in_threads(task)))
            alone = _seconds(task)
            processes.append(2 * alone / _seconds(lambda: _in_processes(workers)))
    return Two(name, n, what, float(np.median(threads)), float(np.median(processes)))


def _task(name: str, n: int, seed: int, what: str, count: int) -> Callable[[], object]:
    """Answers `count` queries."""
    problem = GENERATED[name](n, seed)
    queries = np.resize(problem.queries, (count, problem.queries.shape[1]))
    if what == EXACT:
        tree = build(problem.points)
        return lambda: tree.exact(queries, K)
    model = taught(problem.points)
    return lambda: model.answers(queries)


def _seconds(task: Callable[[], object]) -> float:
    begin = time.perf_counter()
    task()
    return time.perf_counter() - begin


def _in_threads(task: Callable[[], object]) -> None:
    threads = [threading.Thread(target=task) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def _in_processes(workers: list[subprocess.Popen[str]]) -> None:
    for worker in workers:
        assert worker.stdin
        worker.stdin.write("begin\n")
        worker.stdin.flush()
    for worker in workers:
        _told(worker, "done")


def _told(worker: subprocess.Popen[str], word: str) -> None:
    assert worker.stdout
    if worker.stdout.readline().strip() != word:
        raise RuntimeError("a process of the comparison of threads and processes ended early; see its error above")


@contextmanager
def _process(*arguments: object) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "benchmarks.learner.threads", *map(str, arguments)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as worker:
        try:
            _told(worker, "ready")
            yield worker
        finally:
            assert worker.stdin
            worker.stdin.close()
            try:
                worker.wait(END)
            except subprocess.TimeoutExpired:
                worker.kill()


def main() -> None:
    """Makes the task, says so, and does it once for each line of input."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", choices=GENERATED)
    parser.add_argument("n", type=int)
    parser.add_argument("seed", type=int)
    parser.add_argument("what", choices=(EXACT, ANSWERS))
    parser.add_argument("count", type=int)
    given = parser.parse_args()
    task = _task(given.set, given.n, given.seed, given.what, given.count)
    task()
    print("ready", flush=True)
    for _line in sys.stdin:
        task()
        print("done", flush=True)


if __name__ == "__main__":
    main()
