"""How a model answers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

Method = Literal["nearest", "kndb", "kndb2", "local_linear", "local_quadratic", "leaf_map"]

METHODS: tuple[Method, ...] = get_args(Method)
"""In the order of the kernels' numbers."""

SMALLEST_RIDGE = 1e-12
"""With less, degenerate neighbourhoods could not be solved in double precision."""


@dataclass(frozen=True, slots=True)
class Settings:
    """How an answer is made from the samples near the query (thesis 3.3; `approximate` explains the methods)."""

    method: Method = "kndb2"
    neighbours: int | None = 5
    """How many samples are retrieved; all when None or when there are fewer."""
    alpha: float = 3.0
    """How fast the weights of KNDB and KNDB2 fall; at least 1."""
    smoothing: float = 0.1
    """Of the weights of local fits, as a share of the farthest neighbour's distance; above 0."""
    ridge: float = 1e-4
    """How strongly slopes are held small, as a share of the inputs' variance: of local fits, gradients, leaf maps."""
    curvature_ridge: float = 1e-2
    """The same for the second-order terms of `local_quadratic`."""
    gradient_neighbours: int | None = None
    """To how many samples KNDB2's gradients and leaf maps are fitted, the sample itself among them; when None,
    3 (N + 1) for gradients and the thesis's 2 N + 1 for leaf maps, where nobody gave derived points."""
    beam_width: int | None = None
    """Search by a beam of this width, at least `neighbours` (3.2.2); exactly when None."""
    keep_covered: bool = True
    """Whether samples that became no node of the tree stay in their leaf; the thesis drops them."""

    def __post_init__(self) -> None:
        """Checks the values.

        Raises:
            ValueError: one is out of range.
        """
        if self.method not in METHODS:
            raise ValueError(f"method must be one of {', '.join(METHODS)}, not {self.method!r}")
        for name in ("neighbours", "gradient_neighbours", "beam_width"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ValueError(f"{name} must be at least 1, not {value}")
        if self.beam_width is not None and (self.neighbours is None or self.beam_width < self.neighbours):
            raise ValueError(f"beam_width must be at least neighbours, {self.neighbours}, not {self.beam_width}")
        if not 1 <= self.alpha < math.inf:
            raise ValueError(f"alpha must be at least 1 and finite, not {self.alpha}")
        if not 0 < self.smoothing < math.inf:
            raise ValueError(f"smoothing must be above 0 and finite, not {self.smoothing}")
        for name in ("ridge", "curvature_ridge"):
            if not SMALLEST_RIDGE <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be finite and at least {SMALLEST_RIDGE:g}, not {getattr(self, name)}")
