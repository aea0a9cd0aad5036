"""Every system by the name it has in the tables."""

from collections.abc import Callable

from benchmarks.learner.ours import Answering, Beam, Exact
from benchmarks.learner.rivals import RIVALS, Rival

ANSWER, EXACT, BEAM = "handeye, answer", "handeye, exact", "handeye, beam"
BASE = "scipy cKDTree"
"""The tables' ratios are to this one."""
FASTEST_OF = ("brute force (numba)", "scipy cKDTree", "pykdtree")
"""One query per call is also held against the fastest of these."""
GRAPH = "hnswlib"
"""The beam is held against this one, both at the same recall."""

SYSTEMS: dict[str, Callable[[], Rival]] = {ANSWER: Answering, EXACT: Exact, BEAM: Beam, **RIVALS}
