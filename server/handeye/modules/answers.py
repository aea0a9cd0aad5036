"""What a module says, and what it says it of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handeye import rpt

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Neighbour(NamedTuple):
    """A taught sample that an answer was made from."""

    sample_id: int
    """The sample's number in the module."""
    demonstration: str | None
    distance: float
    """From the query, after each component was divided by its scale."""
    weight: float
    """Share in the answer, by distance; the weights of an answer add up to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a module says: the output (in the outputs' units), its neighbours (nearest first), and its support."""

    output: Floats
    neighbours: tuple[Neighbour, ...]
    support: float
    """In [0, 1]: how well inside the taught region the query lies; see `Support`."""
    expected_error: Floats
    """What the error of each output should not exceed in nine of ten cases; infinite while unknown."""


@dataclass(frozen=True, slots=True)
class Support:
    """How far from the taught samples a query may lie, learned by leaving out whole demonstrations.

    A task needs to tell just outside the taught region from far outside, which the learner's own p-value cannot
    (docs/decisions/009). For each sample of a category its distance to the nearest sample of the *other*
    demonstrations is taken: how far one had to reach for a place that was not taught. A query's support is 1 up to the
    median of those distances, falls linearly to 1/2 at the largest, and beyond it is half the largest divided by the
    query's distance: 1/4 at twice, 1/6 at three times the largest. With a single demonstration the distances are those
    among its own samples. A few demonstrations that happen to be alike say little of how far their answers carry: the
    largest is at least half of what the declaration's scales count as a difference, by the root of their number.
    """

    median: float
    largest: float

    def of(self, distances: ArrayLike) -> Floats:
        """The support of queries whose nearest samples lie at `distances`, any shape."""
        away = np.asarray(distances, dtype=np.float64)
        support = np.ones(away.shape)
        between = (away > self.median) & (away < self.largest)
        beyond = (away > self.median) & ~between
        support[between] -= 0.5 * (away[between] - self.median) / (self.largest - self.median)
        support[beyond] = 0.5 * self.largest / away[beyond]
        return support

    def of_one(self, distance: float) -> float:
        """The same for one query, which the way by arrays would take longer for than the answer itself."""
        if distance <= self.median:
            return 1.0
        if distance < self.largest:
            return 1.0 - 0.5 * (distance - self.median) / (self.largest - self.median)
        return 0.5 * self.largest / distance


@dataclass(frozen=True, slots=True)
class CategoryStatistics:
    """What was learned for one combination of categories."""

    category: tuple[float, ...]
    samples: int
    demonstrations: int
    tree: rpt.Statistics
    support: Support


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """What a module says to q queries, as arrays; k neighbours each, nearest first.

    Where there were fewer neighbours, the rest has sample and demonstration -1, an infinite distance and no weight.
    """

    outputs: Floats
    """(q, M) in the outputs' units."""
    support: Floats
    """(q,) see `Support`."""
    expected_error: Floats
    """(q, M) what the error of each output should not exceed in nine of ten cases; infinite while unknown."""
    samples: Integers
    """(q, k) numbers of samples."""
    demonstrations: Integers
    """(q, k) into `names`; -1 for a sample that came from no demonstration."""
    distances: Floats
    """(q, k) from the query, after each component was divided by its scale."""
    weights: Floats
    """(q, k) shares in the answer."""
    names: tuple[str, ...]
    """Demonstrations."""

    def nearest(self, most: int) -> Answers:
        """The same with the nearest `most` neighbours only; it keeps no memory for what it does not tell."""
        return Answers(
            outputs=self.outputs.copy(),
            support=self.support.copy(),
            expected_error=self.expected_error.copy(),
            samples=self.samples[:, :most].copy(),
            demonstrations=self.demonstrations[:, :most].copy(),
            distances=self.distances[:, :most].copy(),
            weights=self.weights[:, :most].copy(),
            names=self.names,
        )

    @classmethod
    def joined(cls, parts: Sequence[Answers]) -> Answers:
        """Answers of one module to some queries, then to more; samples may have come in between."""
        if len(parts) == 1:
            return parts[0]
        widest = max(part.samples.shape[1] for part in parts)

        def wide(name: str, empty: float) -> NDArray[Any]:
            arrays = [getattr(part, name) for part in parts]
            found = np.full((sum(map(len, arrays)), widest), empty, arrays[0].dtype)
            first = 0
            for array in arrays:
                found[first : first + len(array), : array.shape[1]] = array
                first += len(array)
            return found

        return cls(
            outputs=np.concatenate([part.outputs for part in parts]),
            support=np.concatenate([part.support for part in parts]),
            expected_error=np.concatenate([part.expected_error for part in parts]),
            samples=wide("samples", -1),
            demonstrations=wide("demonstrations", -1),
            distances=wide("distances", np.inf),
            weights=wide("weights", 0.0),
            names=max((part.names for part in parts), key=len),
        )


@dataclass(frozen=True, slots=True, eq=False)
class TaughtSamples:
    """n samples of a module, in ascending order of their numbers."""

    numbers: Integers
    """(n,)"""
    inputs: Floats
    """(n, N)"""
    outputs: Floats
    """(n, M)"""
    demonstrations: Sequence[str | None]
    """n names; None for a sample that came from no demonstration."""
