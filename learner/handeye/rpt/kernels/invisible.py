"""Nodes that no query reaches any more (Appendix B)."""

import numpy as np
from numba import njit

from handeye.rpt.kernels.lanes import LANES
from handeye.rpt.kernels.layout import CAPACITY, COUNT, ENTRIES, KIND, NODES, ROOT, WAITING
from handeye.rpt.kernels.nearest import nearest_lane

MOST_SAMPLES = np.iinfo(np.int64).max


@njit(cache=True, nogil=True)
def count_invisible(integers, floats, points):
    """How many nodes cannot be reached by descending with their own vector, and nodes below such (Appendix B)."""
    out = np.empty(LANES)
    invisible = 0
    # Families of nodes still to be looked at, and whether they hang below an invisible node.
    waiting = np.empty((integers[WAITING] + 1, 2), np.int64)
    waiting[0, 0] = integers[ROOT]
    waiting[0, 1] = 0
    top = 1
    while top:
        top -= 1
        family = waiting[top, 0]
        lost = waiting[top, 1]
        for lane in range(integers[family + COUNT]):
            below = integers[family + ENTRIES + lane]
            sample = integers[family + ENTRIES + integers[family + CAPACITY] + lane]
            hidden = lost or not reaches(integers, floats, points[sample], family, lane, out)
            invisible += hidden
            if integers[below + KIND] == NODES:
                waiting[top, 0] = below
                waiting[top, 1] = hidden
                top += 1
    return invisible


@njit(cache=True, nogil=True)
def reaches(integers, floats, vector, family, lane, out):
    """Whether descending by nearest vectors leads to a lane of a family."""
    here = integers[ROOT]
    while integers[here + KIND] == NODES:
        nearest, _ = nearest_lane(vector, integers, floats, here, MOST_SAMPLES, out)
        if here == family:
            return nearest == lane
        here = integers[here + ENTRIES + nearest]
    return False
