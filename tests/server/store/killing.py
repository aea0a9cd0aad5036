"""Processes that are killed while they write samples, and what must be in the store afterwards.

Every sample says which batch it is of and its place in it, so that one that is missing, or there twice, is seen.
"""

from __future__ import annotations

import subprocess
import threading
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from handeye.modules.declaration import ModuleDeclaration
from handeye.server.store import Store, modules
from handeye.server.store.check import verify

DECLARATION = ModuleDeclaration.model_validate(
    {
        "name": "written",
        "inputs": [{"name": name, "unit": ""} for name in ("batch", "place", "size", "noise")],
        "outputs": [{"name": "sum", "unit": ""}, {"name": "noise", "unit": ""}],
    }
)

_ROOT = Path(__file__).parents[3]


@dataclass(frozen=True, slots=True)
class Batch:
    """Samples that were written together; `number` is the caller's own, `first` the number that the store gave."""

    number: int
    count: int
    first: int


def samples_of(number: int, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Inputs (count, 4) and outputs (count, 2) of a batch, the same at every call."""
    places = np.arange(count, dtype=np.float64)
    noise = np.random.default_rng(number).normal(size=count)
    inputs = np.stack([np.full(count, float(number)), places, np.full(count, float(count)), noise], axis=1)
    return inputs, np.stack([inputs.sum(axis=1), -noise], axis=1)


def kill_while_it_writes(command: list[str], delay: float, limit: float = 60.0) -> list[Batch]:
    """Runs a process that prints a line "number count first" for each batch that it was told is durable, and kills it
    `delay` s after the first one. Returns the batches of all lines that came.
    """
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=_ROOT) as process:
        assert process.stdout is not None
        watchdog = threading.Timer(limit, process.kill)
        watchdog.start()
        lines = [process.stdout.readline()]
        killer = threading.Timer(delay, process.kill)
        killer.start()
        lines += process.stdout.readlines()
        for timer in (watchdog, killer):
            timer.cancel()
            timer.join()
        said = process.stderr.read() if process.stderr else ""
    assert process.returncode < 0, f"it ended by itself: {said}"
    assert lines[0], "it wrote nothing"
    return [Batch(*map(int, line.split())) for line in lines if line.endswith("\n")]


def check(url: str, acknowledged: list[Batch]) -> int:
    """Every acknowledged batch is there, once, with the numbers that were said; any other one wholly or not at all.

    The store is well. Returns how many samples there are.
    """
    assert verify(url) == []
    with Store.open(url) as store, store.read() as connection:
        module = modules.get(connection, DECLARATION.name)
        if module is None:
            assert acknowledged == []
            return 0
        pieces = list(modules.read_samples(connection, module))
    found: dict[int, list[tuple[int, NDArray[np.float64], NDArray[np.float64]]]] = defaultdict(list)
    for piece in pieces:
        for row in zip(piece.numbers.tolist(), piece.inputs, piece.outputs, strict=True):
            found[int(row[1][0])].append(row)
    for batch in acknowledged:
        assert [row[0] for row in found[batch.number]] == list(range(batch.first, batch.first + batch.count))
    for number, rows in found.items():
        inputs, outputs = samples_of(number, int(rows[0][1][2]))
        assert np.array_equal([row[1] for row in rows], inputs), f"batch {number}"
        assert np.array_equal([row[2] for row in rows], outputs), f"batch {number}"
    return sum(map(len, found.values()))
