"""What a system's index weighs: built in a fresh process, measured from outside the libraries.

python -m benchmarks.learner.memory SYSTEM POINTS.npy
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.learner.data import ROOT, Floats
from benchmarks.learner.systems import SYSTEMS

TIMEOUT = 900.0
"""s; no build takes longer."""
SMALL = 200
"""A build of so many points goes before: it loads libraries and compiles kernels, whose weight does not count."""


class Weight(NamedTuple):
    """Bytes of resident memory more than before the points were there."""

    kept: int
    """With the index built and the caller's points let go: what the index needs to answer."""
    peak: int
    """The most while it was built, the caller's points among it."""


def weigh(system: str, points: Floats) -> Weight:
    """Builds `system` from (n, d) points in a process of its own. Linux only; to be trusted from about 10 MB on."""
    with tempfile.TemporaryDirectory(prefix="handeye-weigh-") as directory:
        path = Path(directory) / "points.npy"
        np.save(path, points)
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.learner.memory", system, str(path)],
            capture_output=True,
            check=True,
            cwd=ROOT,
            timeout=TIMEOUT,
        )
    return Weight(**json.loads(done.stdout))


def _weigh_here(system: str, path: Path) -> Weight:
    stored = np.load(path, mmap_mode="r")
    rival = SYSTEMS[system]()
    rival.build(np.array(stored[:SMALL]))
    del stored
    _give_back()
    # Resets the peak to what is resident now (man 5 proc_pid_clear_refs).
    Path("/proc/self/clear_refs").write_text("5")
    before = _resident("VmRSS")
    points = np.load(path)
    rival.build(points)
    peak = _resident("VmHWM")
    del points
    _give_back()
    return Weight(kept=_resident("VmRSS") - before, peak=peak - before)


def _give_back() -> None:
    """Lets go of all that nobody needs, also of what glibc keeps for the next one who asks for memory."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def _resident(field: str) -> int:
    """Bytes, as the kernel counts this process's pages."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{field}:"))


def main() -> None:
    """Builds and prints the weight as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("system", choices=SYSTEMS)
    parser.add_argument("points", type=Path)
    arguments = parser.parse_args()
    print(json.dumps(_weigh_here(arguments.system, arguments.points)._asdict()))


if __name__ == "__main__":
    main()
