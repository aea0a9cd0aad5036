"""Samples that show something: the thesis's own examples, with coordinates of ours, and inputs that ask for trouble.

The thesis's figures are lost; the coordinates are chosen so that all happens as captions and text say.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Plane = tuple[float, float]

# Construction, Figs 3.19 to 3.35; retrieval, Figs 3.14 to 3.17.
WALKTHROUGH: dict[str, Plane] = {
    "A": (0.0, 0.0),
    "B": (20.0, 0.0),
    "a": (-6.0, 1.0),
    "b": (1.0, -6.0),
    "C": (11.0, 20.0),
    "c": (20.0, -6.0),
    "d": (4.5, 4.5),
    "e": (24.0, 5.0),
    "α": (7.5, 4.5),
    "β": (4.5, 7.5),
    "χ": (1.5, 4.5),
    "δ": (4.5, 1.5),
    "f": (5.5, 22.0),
    "ε": (24.0, 8.0),
    "g": (16.0, 22.5),
    "φ": (5.4, 5.4),
}
WALKTHROUGH_RADII = (10.0, 4.0, 2.0)
WALKTHROUGH_QUERY = (6.0, 0.2)

ADDED = [
    *[("Fig 3.20", 1, "A"), ("Fig 3.21", 1, "B"), ("Fig 3.22", 1, "C")],
    *[("Fig 3.23", 2, "a"), ("Fig 3.24", 2, "b"), ("Fig 3.25", 2, "c"), ("Fig 3.26", 2, "d"), ("Fig 3.27", 2, "e")],
    *[("Fig 3.28", 2, "f"), ("Fig 3.29", 2, "g")],
    *[("Fig 3.30", 3, "α"), ("Fig 3.31", 3, "β"), ("Fig 3.32", 3, "χ"), ("Fig 3.33", 3, "δ"), ("Fig 3.34", 3, "ε")],
]
"""By the captions: in which figure, on which level, which sample becomes a node. In Fig 3.35 φ does not."""

# Fig 3.36: e is nearer to B than to C and so below B; the query is nearer to C, and to e than to any other sample.
MISS: dict[str, Plane] = {"B": (0.0, 0.0), "C": (20.0, 0.0), "e": (9.0, 3.0), "f": (14.5, -2.5)}
MISS_RADII = (12.0, 4.0)
MISS_QUERY = (11.5, 1.5)

# Fig B.1: C comes last, on a higher level than A, and captures A with all that is below it. c is covered by A.
ADOPTION: dict[str, Plane] = {
    "B": (0.0, 0.0),
    "b": (-5.0, 2.0),
    "A": (8.0, 2.0),
    "a": (8.5, 4.5),
    "c": (8.3, 0.7),
    "C": (12.5, 1.0),
}
ADOPTION_RADII = (10.0, 4.0, 1.5)

# Appendix C: four samples on level 1 (T4), and a fifth that divides the first one's cell (T5).
CHANGELING_SAMPLES: list[Plane] = [(0.0, 0.0), (9.0, 1.0), (1.0, 9.0), (-9.0, -2.0)]
CHANGELING_NEW: Plane = (2.5, 1.0)
CHANGELING_RADII = (4.0, 2.0)


def changeling_teacher(inputs: Floats) -> Floats:
    """The function to be learned, (j, 2) to (j, 1)."""
    return 5 * np.sin(inputs[:, :1] / 3) * np.cos(inputs[:, 1:] / 4)


CHANGELINGS: dict[str, Plane] = {
    "I": (2.5, 0.5),
    "II": (2.55, -0.95),
    "III": (4.0, 4.0),
    "IV": (4.0, -3.0),
    "V": (-3.5, 0.0),
}
"""A query of each case: it changes its leaf from T4 to T5. The error falls in I to III and grows in IV and V."""


def adversarial() -> dict[str, Floats]:
    """Sets of samples on which trees go wrong; with radii of about 0.5 to 8, or derived ones."""
    scattered = np.random.default_rng(5).normal(size=(50, 2)) * 4
    line = np.outer(np.linspace(0, 12, 49), [3.0, -1.0])
    grid = np.stack(np.meshgrid(np.arange(-3.0, 4.0), np.arange(-3.0, 4.0)), axis=-1).reshape(-1, 2)
    tight = scattered * 0.01
    return {
        "one sample": np.zeros((1, 3)),
        "identical points": np.ones((30, 2)),
        "duplicates": np.repeat(scattered[:10], 4, axis=0),
        "duplicates, interleaved": np.tile(scattered[:10], (4, 1)),
        "scattered": scattered,
        "scattered, reversed": scattered[::-1].copy(),
        "collinear": line,
        "collinear, reversed": line[::-1].copy(),
        "collinear, from the middle out": line[np.argsort(np.abs(np.arange(49) - 24), kind="stable")],
        "grid with ties": grid,
        "grid with ties, reversed": grid[::-1].copy(),
        "grid with ties, shuffled": np.random.default_rng(6).permutation(grid),
        "two tight clusters": np.concatenate([tight, tight + 1000.0]),
        "two tight clusters, interleaved": np.stack([tight, tight + 9.0], axis=1).reshape(-1, 2),
        "geometric sequence": 2.0 ** np.arange(-10, 30)[:, np.newaxis],
        "one component that never changes": np.column_stack([scattered, np.full(50, 7.0)]),
    }
