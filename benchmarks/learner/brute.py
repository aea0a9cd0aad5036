"""Brute force in numba, written as well as it can be: all n distances, the k smallest kept by insertion.

Measured before it was chosen (k = 5, µs per call; 800 and 10^5 points): rows with the number of components known to
the compiler 2.4 and 89 in 3-D, 3.4 and 186 in 6-D, with a running number 4.0 and 261 in 11-D, 3.8 and 280 in 16-D.
Slower or equal: a running number in 3-D (2.9, 171), a fixed one in 16-D (7.2, 679), the transpose (d, n) in strips of
256 points (3.1 and 225 in 3-D, 11 and 3000 in 16-D), blocks of 8, 16, 32 or 64 points with their components transposed
(2.4 and 91 in 3-D, 6.8 and 635 in 16-D), rows padded to whole vectors. Filling arrays that the caller made costs 0.5 µs
per call less than returning new ones.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

FIXED_UP_TO = 8
"""Up to so many components the compiler is told how many there are."""


def compiled(d: int) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """The search for points with d components: for one query, and for several.

    one(points, query, ids, distances) fills ids (k,) and distances (k,), nearest first; points (n, d), query (d,).
    many(points, queries, ids, distances) does so for queries (q, d), ids (q, k) and distances (q, k).
    """
    fixed = d <= FIXED_UP_TO

    def one(points: Any, query: Any, ids: Any, distances: Any) -> None:
        k = ids.shape[0]
        for i in range(k):
            distances[i] = np.inf
        worst = np.inf
        for i in range(points.shape[0]):
            squared = 0.0
            for j in range(d if fixed else points.shape[1]):
                difference = points[i, j] - query[j]
                squared += difference * difference
            if squared < worst:
                place = k - 1
                while place > 0 and distances[place - 1] > squared:
                    distances[place] = distances[place - 1]
                    ids[place] = ids[place - 1]
                    place -= 1
                distances[place] = squared
                ids[place] = i
                worst = distances[k - 1]
        for i in range(k):
            distances[i] = np.sqrt(distances[i])

    # Sums may be reordered and fused; infinities mean what they say.
    loose = njit(nogil=True, fastmath={"nnan", "nsz", "arcp", "contract", "reassoc"})
    one_compiled = loose(one)

    def many(points: Any, queries: Any, ids: Any, distances: Any) -> None:
        for i in range(queries.shape[0]):
            one_compiled(points, queries[i], ids[i], distances[i])

    return one_compiled, loose(many)
