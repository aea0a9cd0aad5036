"""What is learned for one combination of categories: a tree, outputs, and what the samples say about themselves."""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handeye.rpt.answers import Answer, Source
from handeye.rpt.calibration import Calibration, calibrate
from handeye.rpt.kernels import answer as kernel
from handeye.rpt.kernels.answer import answer_many
from handeye.rpt.kernels.calibrate import estimate_gradients, estimated_from, joined_by, publish_rows
from handeye.rpt.kernels.table import Table
from handeye.rpt.settings import METHODS, Settings
from handeye.rpt.tree import Scalar, Tree, build, larger

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

STALE = 1 / 4
"""Support and expected errors are calibrated anew once the samples have grown by this share."""

TANGENTS = ("kndb2", "leaf_map")
"""The methods that know a gradient at each sample."""


NOTHING: Integers = np.zeros(0, np.int64)


class Samples(NamedTuple):
    """n samples as a region takes them."""

    points: Floats
    """(n, d) inputs without the categories, scaled."""
    outputs: Floats
    """(n, p)"""
    groups: Integers
    """(n,)"""
    numbers: Integers
    """(n,) theirs in the model."""
    maps: Floats | None
    """(n, p, d) gradients that were given, by scaled inputs; NaN where they are to be estimated, None when all are."""

    def chosen(self, rows: Integers) -> Samples:
        """Some of them."""
        maps = None if self.maps is None else self.maps[rows]
        return Samples(self.points[rows], self.outputs[rows], self.groups[rows], self.numbers[rows], maps)


class State(NamedTuple):
    """All that a query needs, replaced as a whole: a query never mixes two states."""

    numbers: Integers
    """What `kernels.answer.answer_one` takes; the table keeps alive what they point to."""
    length: int
    """Of an answer's row."""
    source: Source
    table: Table


class Region:
    """Samples of one category with their outputs."""

    def __init__(
        self,
        samples: Samples,
        settings: Settings,
        factors: Floats,
        components: tuple[Integers, int],
        radii: Floats | None,
    ) -> None:
        """Learns samples: factors (d,) scale queries as they scaled the points, components are those of `Source`."""
        self.settings = settings
        self._factors = factors
        self._components = components
        self.tree: Tree = build(samples.points, radii=radii, keep_covered=settings.keep_covered)
        self._learning = threading.Lock()
        self._outputs = samples.outputs.shape[1]
        self._tangents = settings.method in TANGENTS
        n = len(samples.points)
        width = self._outputs + (self._outputs * len(factors) + 2 if self._tangents else 0)
        self._knowledge = np.zeros((n, width))
        self._end = 0
        self._rows = np.zeros(n if self._tangents else 0, np.int64)
        self._groups = samples.groups.astype(np.int64)
        self._numbers = samples.numbers.astype(np.int64)
        self._identity = True
        self._calibration = Calibration.unknown(self._outputs)
        self._remember(0, samples)
        self._refresh()
        self._estimate(NOTHING, np.flatnonzero(self.tree.alive))
        self._calibrate()

    def living(self) -> Samples:
        """The samples that have not been removed, in the order they came."""
        alive = np.flatnonzero(self.tree.alive)
        known = self._knowledge[self._rows[alive] if self._tangents else alive]
        maps = None
        if self._tangents:
            maps = known[:, self._outputs : -2].reshape(len(alive), self._outputs, -1)
            maps[known[:, -2] != kernel.GIVEN] = np.nan
        outputs = known[:, : self._outputs].copy()
        return Samples(self.tree.points[alive], outputs, self._groups[alive], self._numbers[alive], maps)

    @property
    def calibration(self) -> Calibration:
        """What support and expected errors go by."""
        return self._calibration

    @property
    def groups(self) -> Integers:
        """(n,) those of all samples ever learned."""
        return self._groups[: len(self.tree.points)]

    def learn(self, samples: Samples) -> Integers:
        """Adds samples; the next query knows them. Returns their numbers in this region."""
        with self._learning:
            first = len(self.tree.points)
            self._make_room(first, len(samples.points))
            self._remember(first, samples)
            # Whoever answers goes by the last state and knows no sample of a larger number until the next one is there.
            numbers = self.tree.insert(samples.points)
            if self._tangents:
                # Twice as many as make a neighbourhood are looked at; `repair` would find the rest.
                k = 2 * int(self._rule[kernel.GRADIENT_NEIGHBOURS])
                known = (*self.tree.arenas, self.tree.storage, self._knowledge, self._rows)
                self._estimate(joined_by(first, first + len(numbers), k, *known), numbers)
            self._refresh()
            if self.tree.samples > (1 + STALE) * self._calibrated:
                self._calibrate()
            return numbers

    def forget(self, numbers: Integers) -> None:
        """Takes samples out; the next query does not know them."""
        with self._learning:
            touched = NOTHING
            if self._tangents:
                rows = self._rows[: len(self.tree.points)]
                touched = np.flatnonzero(estimated_from(numbers, self.tree.storage, self._knowledge, rows))
            self.tree.remove(numbers)
            self._refresh()
            if self.tree.samples:
                self._estimate(touched[self.tree.alive[touched]])
                self._calibrate()

    def repair(self) -> None:
        """`Tree.repair`, and all gradients anew."""
        with self._learning:
            self.tree.repair()
            self._estimate(np.flatnonzero(self.tree.alive))
            self._calibrate()

    def answers(self, queries: Floats) -> tuple[int, Answer]:
        """Several queries (q, d) in the model's units: the outcome for the first that was not answered, and answers."""
        state = self.state
        rows = np.empty((len(queries), state.length))
        return int(answer_many(queries, *state.table.arrays, rows)), Answer(rows, state.source)

    def _make_room(self, first: int, more: int) -> None:
        self.tree.reserve(more)
        self._groups = with_room(self._groups, first, more)
        self._numbers = with_room(self._numbers, first, more)
        self._rows = with_room(self._rows, first, more) if self._tangents else self._rows

    def _remember(self, first: int, samples: Samples) -> None:
        """Writes down what came with samples; nobody is told yet."""
        self._identity &= np.array_equal(samples.numbers, np.arange(first, first + len(samples.points)))
        n = len(samples.points)
        rows = self._new_rows(n)
        self._knowledge[rows] = 0.0
        self._knowledge[rows, : self._outputs] = samples.outputs
        self._groups[first : first + n] = samples.groups
        self._numbers[first : first + n] = samples.numbers
        if self._tangents:
            self._rows[first : first + n] = rows
            if samples.maps is not None:
                maps = samples.maps.reshape(n, -1)
                given = rows[~np.isnan(maps).any(axis=1)]
                self._knowledge[given, self._outputs : -2] = maps[given - rows[0]]
                self._knowledge[given, -2:] = (kernel.GIVEN, -1.0)

    def _new_rows(self, n: int) -> Integers:
        """Numbers of n rows of knowledge that nobody reads. Outdated rows are left behind when room must be made."""
        if self._end + n > len(self._knowledge):
            if self._tangents:
                known = len(self.tree.points) if self._end else 0
                # Readers go on with the old arrays.
                kept = self._knowledge[self._rows[:known]]
                self._rows = self._rows.copy()
                self._rows[:known] = np.arange(known)
                self._knowledge, self._end = kept, known
            self._knowledge = with_room(self._knowledge, self._end, n + self._end)
        first, self._end = self._end, self._end + n
        return np.arange(first, self._end)

    def _estimate(self, known: Integers, new: Integers = NOTHING) -> None:
        """Gradients at samples that readers know, into rows that they don't, and at new ones, where these stand."""
        if not self._tangents:
            return
        targets = self._new_rows(len(known))
        chosen, targets = np.concatenate([known, new]), np.concatenate([targets, self._rows[new]])
        arrays = (*self.tree.arenas, self.tree.storage, self._knowledge, self._rows, self._rule)
        estimate_gradients(chosen, *arrays, targets)
        publish_rows(self._rows, chosen, targets)

    def _calibrate(self) -> None:
        self._calibration = calibrate(self.tree, self._knowledge, self._rows, self.groups, self._rule)
        self._calibrated = self.tree.samples
        self._refresh()

    def _refresh(self) -> None:
        """Makes what queries go by fit what is there now."""
        known = len(self.tree.points)
        self._rule = rule_for(self.settings, self._outputs, self.tree.samples, known, self._factors)
        neighbours = int(self._rule[kernel.NEIGHBOURS])
        arenas = self.tree.arenas
        scores = self._calibration.scores
        table = Table(*arenas, self.tree.storage, self._knowledge, self._rows, self._rule, scores)
        length = int(kernel.row_length(self._outputs, len(self._factors), neighbours))
        components, all_components = self._components
        numbers_in_model = None if self._identity else self._numbers
        source = Source(
            self._outputs, neighbours, components, all_components, numbers_in_model, self._groups, self._calibration
        )
        self.state = State(table.numbers, length, source, table)


def rule_for(settings: Settings, outputs: int, samples: int, limit: int, factors: Floats) -> Floats:
    """What `kernels.answer` goes by: `samples` can answer, with numbers below `limit`; factors (d,) scale queries."""
    d = len(factors)
    neighbours = min(1 if settings.method in ("nearest", "leaf_map") else settings.neighbours or samples, samples)
    gradient = settings.gradient_neighbours or (3 * (d + 1) if settings.method == "kndb2" else 2 * d + 1)
    numbers = [METHODS.index(settings.method), neighbours, outputs, settings.alpha, settings.smoothing]
    numbers += [settings.ridge, settings.curvature_ridge, settings.beam_width or 0, gradient, limit]
    return np.array(numbers + factors.tolist())


def with_room(array: NDArray[Scalar], size: int, more: int) -> NDArray[Scalar]:
    """The array, or a larger copy of its first `size` rows, with room for `more` behind them."""
    if size + more <= len(array):
        return array
    return larger(array[:size], max(size + more, 2 * len(array)))
