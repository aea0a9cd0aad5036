"""Radii derived from the data: as many levels as it takes, with a bounded number of children."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handeye.rpt.checks import as_points
from handeye.rpt.kernels.radii import derive

Floats = NDArray[np.float64]

FAN_OUT = 32
"""How many children the nodes looked at have at most when the radii are derived from the data. Other nodes of the same
level, and the tails of the data, may have more: twice as many in three dimensions, five times in thirty (measured)."""

LEAF = 4096
"""There are as many levels as would leave about so few samples in a leaf if every node had FAN_OUT children. Leaves lay
their samples into pages (`kernels.layout`), which divides them faster and better than further levels would."""


def derive_radii(inputs: ArrayLike, *, fan_out: int = FAN_OUT) -> Floats:
    """Radii T(1) > ... > T(L) under which a node has up to about `fan_out` children, whatever the dimension.

    T(1) is the smallest radius under which `fan_out` samples, chosen as the tree chooses its nodes (Fig 3.18), cover
    samples spread over the order given: one in sixteen, but at least 256 if there are, and at most 4096. T(l + 1) is
    found in the same way from the samples within T(l) of four samples: it is the smallest radius that needs no more
    than `fan_out` nodes in any of the four places. L is the smallest number with fan_out^L >= n / 4096, at least 1;
    fewer where the next radius would be no tenth smaller, as among coincident samples.

    Raises:
        ValueError: inputs are empty, not finite or of the wrong shape; fan_out is below 2.
    """
    points = as_points(inputs)
    if fan_out < 2:
        raise ValueError(f"fan_out must be at least 2, not {fan_out}")
    return radii_of(points, fan_out)


def radii_of(points: Floats, fan_out: int = FAN_OUT) -> Floats:
    """`derive_radii` of an array that has been checked."""
    radii: Floats = derive(points, fan_out, LEAF)
    return radii if radii.size else np.zeros(1)
