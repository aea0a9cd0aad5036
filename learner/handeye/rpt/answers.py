"""What a model says to queries, and why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from handeye.rpt.calibration import Calibration
from handeye.rpt.kernels import answer as kernel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Source(NamedTuple):
    """What an answer's numbers refer to: one region as it was when it answered."""

    outputs: int
    neighbours: int
    components: Integers
    """(d,) which of the model's N input components take part in distances; the others are categories."""
    all_components: int
    """N."""
    numbers: Integers | None
    """The samples' numbers in the model by their numbers in the region; None where they are the same."""
    groups: Integers
    """(n,) theirs, by their numbers in the region."""
    calibration: Calibration


class NeighbourOf(NamedTuple):
    """A sample that an answer to one query was made from."""

    id: int
    """Its number."""
    group: int
    """The group (demonstration) that it belongs to; -1 - number for a sample without one."""
    distance: float
    """From the query, in units of the scales."""
    weight: float
    """Its share in the answer."""


class Answer:
    """An answer to one query, or to several at once.

    Shapes are given for one query; for q queries each has a leading axis (q,). k neighbours were asked for; where
    there were fewer, the rest has ids of -1, infinite distances and no weight. Everything refers to the samples known
    when the query came.
    """

    __slots__ = ("_rows", "_source")

    def __init__(self, rows: Floats, source: Source) -> None:
        """Use `Model.answer`. Rows, one or (q, ...), are those of `kernels.answer`."""
        self._rows = rows
        self._source = source

    @property
    def output(self) -> Floats:
        """(M,) in the outputs' units."""
        return self._rows[..., : self._source.outputs]

    @property
    def gradient(self) -> Floats:
        """(M, N) derivatives of the output by the input, in their units; 0 for categories.

        Those of the local polynomial; for methods by weights the weighted mean of the neighbours' gradients, where
        the method knows them (KNDB2, leaf maps), else 0.
        """
        source = self._source
        p, d = source.outputs, len(source.components)
        known = self._rows[..., p : p + p * d].reshape(*self._rows.shape[:-1], p, d)
        if d == source.all_components:
            return known
        found = np.zeros((*known.shape[:-1], source.all_components))
        found[..., source.components] = known
        return found

    @property
    def support(self) -> Floats:
        """() how well inside the taught region the query lies, in (0, 1]: a conformal p-value (`Calibration`)."""
        return self._extra(kernel.SUPPORT)

    @property
    def determined(self) -> NDArray[np.bool_]:
        """() whether the neighbours determine the slopes that the answer uses; where not, a ridge kept them small."""
        return self._extra(kernel.DETERMINED) > 0

    @property
    def ids(self) -> Integers:
        """(k,) numbers of the samples that the answer was made from, nearest first."""
        local = self._local_ids()
        numbers = self._source.numbers
        return local if numbers is None else np.where(local < 0, -1, numbers[local])

    @property
    def groups(self) -> Integers:
        """(k,) the groups (demonstrations) that those samples belong to; -1 - number for a sample without one."""
        local = self._local_ids()
        return np.where(local < 0, -1, self._source.groups[local])

    @property
    def distances(self) -> Floats:
        """(k,) theirs from the query, in units of the scales."""
        return self._neighbours(1)

    @property
    def weights(self) -> Floats:
        """(k,) their shares in the answer; they add up to 1."""
        return self._neighbours(2)

    @property
    def expected_error(self) -> Floats:
        """(M,) what the error of each output should not exceed in nine of ten cases (`Calibration`)."""
        scaled = self._rows[..., -len(self._source.components) :]
        one = scaled.ndim == 1
        expected = self._source.calibration.expected_errors(scaled[np.newaxis] if one else scaled)
        return expected[0] if one else expected

    def nearest(self, most: int | None = None) -> list[NeighbourOf]:
        """The nearest `most` neighbours of an answer to one query, all when None, as plain numbers."""
        source = self._source
        k = source.neighbours
        first = source.outputs * (1 + len(source.components)) + kernel.EXTRAS
        shown = k if most is None else min(most, k)
        row = self._rows[first : first + 3 * k].tolist()
        local = [int(number) for number in row[:shown] if number >= 0]
        groups = source.groups.take(local).tolist()
        ids = local if source.numbers is None else source.numbers.take(local).tolist()
        distances, weights = row[k : k + len(ids)], row[2 * k : 2 * k + len(ids)]
        return list(map(NeighbourOf, ids, groups, distances, weights))

    def _extra(self, column: int) -> Floats:
        extra: Floats = self._rows[..., self._source.outputs * (1 + len(self._source.components)) + column]
        return extra

    def _neighbours(self, block: int) -> Floats:
        source = self._source
        first = source.outputs * (1 + len(source.components)) + kernel.EXTRAS + block * source.neighbours
        return self._rows[..., first : first + source.neighbours]

    def _local_ids(self) -> Integers:
        return self._neighbours(0).astype(np.int64)


class MixedAnswer(Answer):
    """An answer to queries of several categories, which several regions gave."""

    __slots__ = ("_parts", "_places")

    def __init__(self, parts: Sequence[Answer], places: Sequence[Integers]) -> None:
        """Parts to several queries each, and which of the queries those are."""
        self._parts = parts
        self._places = places

    def _merge(self, name: str) -> Any:
        """A property of all parts, in the order of the queries."""
        found = [getattr(part, name) for part in self._parts]
        # A region with fewer neighbours than another leaves the rest empty.
        widest = np.max([part.shape[1:] for part in found], axis=0, initial=0)
        empty = 0.0 if name == "weights" else {"i": -1, "f": np.inf, "b": False}[found[0].dtype.kind]
        merged = np.full((sum(map(len, self._places)), *widest), empty, found[0].dtype)
        for which, part in zip(self._places, found, strict=True):
            inside: tuple[Any, ...] = (which, *map(slice, part.shape[1:]))
            merged[inside] = part
        return merged


def _merged(name: str) -> property:
    return property(lambda answer: answer._merge(name), doc=getattr(Answer, name).__doc__)


# Whatever an answer of one region tells, an answer of several tells for all of them.
for _name in [each for each, value in vars(Answer).items() if isinstance(value, property)]:
    setattr(MixedAnswer, _name, _merged(_name))
