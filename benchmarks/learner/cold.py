"""How long a fresh process takes from its start to its first answer."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

import numpy as np

RUNS = 5
TIMEOUT = 600.0
"""s"""
SCRIPT = """
import numpy as np
import handeye.rpt as rpt

inputs = np.random.default_rng(31).normal(size=(800, 3))
model = rpt.Model(3, 6, rpt.Settings("kndb2"))
model.learn(inputs, np.tanh(inputs @ np.ones((3, 6))))
assert np.isfinite(model.answer(inputs[0] + 0.1).output).all()
"""


class Cold(NamedTuple):
    """s of wall time: interpreter, imports, 800 samples in 3-D learned, one query answered, end of the process."""

    cached: float
    """With numba's cache on disk; median."""
    uncached: float | None
    """Without: everything is compiled first, as after the installation."""


def cold(*, uncached: bool = True) -> Cold:
    """Starts processes one after the other."""
    _seconds({})
    with_cache = float(np.median([_seconds({}) for _ in range(RUNS)]))
    if not uncached:
        return Cold(with_cache, None)
    with tempfile.TemporaryDirectory(prefix="handeye-cold-") as directory:
        return Cold(with_cache, _seconds({"NUMBA_CACHE_DIR": directory}))


def _seconds(environment: dict[str, str]) -> float:
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-c", SCRIPT], env=os.environ | environment, check=True, timeout=TIMEOUT)
    return time.perf_counter() - begin
