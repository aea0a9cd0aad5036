"""Samples for CSS from a grid target: its intersections in both pictures, and where they are in the camera's frame.

Who holds the grid knows where it is: the thesis's stood on a rail, at measured depths (4.2.3). Only training uses it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handeye.modules import css
from handeye.server.collecting.gathering import Gathering
from handeye.server.livemodules import LiveModules
from handeye.server.results import CollectResult


def learn_view(
    modules: LiveModules, seen: NDArray[np.float64], points: NDArray[np.float64], every: int
) -> CollectResult:
    """Teaches CSS one view of a grid.

    Args:
        modules: CSS must be among them.
        seen: (rows, columns, 3) its intersections as (row, column, disparity) in px.
        points: (rows, columns, 3) the same in m in the left camera's frame.
        every: only every so manyth row and column is learned.
    """
    gathering = Gathering(modules, (css.DECLARATION,))
    name = f"view-{gathering.origins('CSS', 'view') + 1}"
    inputs, outputs = (grid[::every, ::every].reshape(-1, 3) for grid in (seen, points))
    gathering.add("CSS", inputs, outputs, [name] * len(inputs))
    return gathering.result
