"""A module: it is taught samples, and answers queries with what near samples say, where they came from and how far to
trust it.

Samples are partitioned by their categorical components: each combination has a tree of its own, so neighbours never
cross subtasks.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from handeye import rpt
from handeye.modules.answers import (
    Answer,
    Answers,
    CategoryStatistics,
    Floats,
    Integers,
    Neighbour,
    Support,
    TaughtSamples,
)
from handeye.modules.declaration import ApproximatorSettings, Component, ModuleDeclaration, Output
from handeye.rpt import Calibration, Model, NotTaught
from handeye.rpt.kernels.answer import LARGEST


class Module:
    """A declared map from inputs to outputs, learned from examples.

    Samples are numbered in the order in which they come. `answer` and `answers` may be called from several threads,
    also while samples come and go: they speak for the samples known when they began.
    """

    def __init__(self, declaration: ModuleDeclaration) -> None:
        self.declaration = declaration
        self._learned = _Learned(self._new_model(), [], 0)
        self._learning = threading.Lock()

    @classmethod
    def restored(cls, declaration: ModuleDeclaration, samples: TaughtSamples, size: int) -> Module:
        """A module that knows these samples by their numbers; the next one gets number `size`.

        Raises `ValueError` as `learn` does, and for numbers that do not ascend below `size`.
        """
        module = cls(declaration)
        rows, values = samples.inputs, samples.outputs
        if len(rows):
            module.checked(rows, values, samples.demonstrations)
        learned = _Learned(module._new_model(), [], size)
        plain, arrays = learned.model.to_state()
        categorical = np.isin(np.arange(rows.shape[1]), learned.model.categorical)
        numbers = np.asarray(samples.numbers, np.int64)
        arrays |= {
            "categories": rows[:, categorical],
            # Not divided: to the last bit the points that the model makes of samples when it learns them.
            "points": rows[:, ~categorical] * (1 / learned.model.scales[~categorical]),
            "outputs": values,
            "groups": _groups(learned.names, samples.demonstrations, numbers),
            "numbers": numbers,
            "maps": np.full((len(rows), values.shape[1], int((~categorical).sum())), np.nan),
        }
        module._learned = learned._replace(model=Model.from_state(plain | {"size": size}, arrays))
        return module

    @cached_property
    def operations(self) -> int:
        """About how many multiplications an answer takes at most; finding neighbours is not among them."""
        inputs, settings = len(self.declaration.inputs), self.declaration.approximator
        terms = {"local_linear": inputs + 1, "local_quadratic": (inputs + 1) * (inputs + 2) // 2}
        fitted, k = terms.get(settings.method, 1), settings.most_neighbours
        return fitted * fitted * (k + fitted) + k * inputs * (len(self.declaration.outputs) + 1)

    @property
    def samples(self) -> int:
        """How many samples can answer."""
        return self._learned.model.samples

    def train(
        self, inputs: ArrayLike, outputs: ArrayLike, demonstrations: Sequence[str | None]
    ) -> tuple[CategoryStatistics, ...]:
        """Learns the samples given, and only those; returns what was learned for each combination of categories.

        Raises as `learn` does.
        """
        rows, values = self.checked(inputs, outputs, demonstrations)
        with self._learning:
            self._learned = self._taught(_Learned(self._new_model(), [], 0), rows, values, demonstrations)
        return self.statistics()

    def learn(self, inputs: ArrayLike, outputs: ArrayLike, demonstrations: Sequence[str | None]) -> Integers:
        """Adds samples; the next query knows them. Returns their numbers (n,).

        Args:
            inputs: (n, N) in the declared order and units; a category is a number that must recur exactly.
            outputs: (n, M) in the declared order and units.
            demonstrations: the demonstration each sample came from, n names; None for none.

        Raises:
            ValueError: shapes do not fit the declaration or each other; a value is not finite; there is no sample.
        """
        rows, values = self.checked(inputs, outputs, demonstrations)
        with self._learning:
            first = self._learned.size
            self._learned = self._taught(self._learned, rows, values, demonstrations)
        return np.arange(first, first + len(rows))

    def forget(self, numbers: ArrayLike) -> None:
        """Takes samples out by their numbers; the next query does not know them. `ValueError` for an unknown one."""
        with self._learning:
            self._learned.model.forget(numbers)

    def statistics(self) -> tuple[CategoryStatistics, ...]:
        """What was learned, by category; empty before training."""
        model = self._learned.model
        found = []
        for category, each in model.statistics().items():
            with suppress(NotTaught):  # its samples were taken out just now
                support = self._support_of(model, category)
                found.append(CategoryStatistics(category, each.samples, each.groups, each.tree, support))
        return tuple(found)

    def tree(self, category: tuple[float, ...] = ()) -> rpt.Tree:
        """The tree of one category, over inputs divided by their scales. `NotTaught` when there is none."""
        return self._learned.model.tree(category)

    def answer(self, query: ArrayLike, neighbours: int | None = None) -> Answer:
        """What the samples near the query say.

        Args:
            query: (N,) in the declared order and units.
            neighbours: so many of the samples that the answer is made from are told, the nearest; None: all of them.

        Raises:
            NotTaught: there are no samples of the query's category.
            ValueError: the query does not fit the declaration or is not finite.
        """
        row = np.array(query, dtype=np.float64)
        if row.ndim != 1:
            raise ValueError(f"a query is one vector, not of shape {row.shape}")
        model, names, _ = self._learned
        if len(row) != model.components:
            self._rows(row[np.newaxis], model.components, "a query")  # raises
        try:
            said = model.answer(row)
        except NotTaught as nothing:
            raise NotTaught(self._nothing_for(row[np.newaxis], model)) from nothing
        near = said.nearest(None if neighbours is None else max(neighbours, 1))
        category = tuple(row[list(model.categorical)].tolist()) if model.categorical else ()
        support = self._support_of(model, category).of_one(near[0].distance)
        told = tuple(
            [
                Neighbour(number, None if group >= _OWN else names[group], distance, weight)
                for number, group, distance, weight in near[:neighbours]
            ]
        )
        return Answer(said.output, told, support, said.expected_error)

    def answers(self, queries: ArrayLike) -> Answers:
        """What the samples near each of several queries (q, N) say. Raises as `answer` does."""
        rows = self._rows(queries, len(self.declaration.inputs), "a query")
        model, names, _ = self._learned
        try:
            said = model.answers(rows)
        except NotTaught as nothing:
            raise NotTaught(self._nothing_for(rows, model)) from nothing
        groups, distances = said.groups, said.distances
        return Answers(
            outputs=said.output,
            support=self._supports(model, rows, distances[:, 0]),
            expected_error=said.expected_error,
            samples=said.ids,
            demonstrations=np.where(groups >= _OWN, -1, groups),
            distances=distances,
            weights=said.weights,
            names=tuple(names),
        )

    def _supports(self, model: Model, rows: Floats, nearest: Floats) -> Floats:
        """(q,) the support of queries (q, N) whose nearest samples lie at `nearest` (q,)."""
        if not model.categorical:
            return self._support_of(model, ()).of(nearest)
        found = np.empty(len(rows))
        categories, which = np.unique(rows[:, list(model.categorical)], axis=0, return_inverse=True)
        for number, category in enumerate(map(tuple, categories.tolist())):
            mine = which.reshape(-1) == number
            found[mine] = self._support_of(model, category).of(nearest[mine])
        return found

    def _support_of(self, model: Model, category: tuple[float, ...]) -> Support:
        """Kept until the category is calibrated anew: the median of all scores takes longer than an answer."""
        calibration = model.calibration(category)
        kept = self._supports_kept.get(category)
        if kept is None or kept[0] is not calibration:
            # Counting the demonstrations of many samples would take long, and makes no difference.
            few = model.tree(category).samples <= _FEW
            shown = model.statistics()[category].groups if few else _FEW
            kept = self._supports_kept[category] = (calibration, _support(calibration, shown))
        return kept[1]

    def _taught(
        self, learned: _Learned, rows: Floats, values: Floats, demonstrations: Sequence[str | None]
    ) -> _Learned:
        numbers = np.arange(learned.size, learned.size + len(rows))
        learned.model.learn(rows, values, _groups(learned.names, demonstrations, numbers))
        return learned._replace(size=learned.size + len(rows))

    def _new_model(self) -> Model:
        inputs, settings = self.declaration.inputs, self.declaration.approximator
        categorical = [i for i, component in enumerate(inputs) if component.categorical]
        scales = [component.scale for component in inputs]
        self._supports_kept: dict[tuple[float, ...], tuple[Calibration, Support]] = {}
        return Model(
            len(inputs), len(self.declaration.outputs), settings.for_model(), scales=scales, categorical=categorical
        )

    def _nothing_for(self, queries: Floats, model: Model) -> str:
        taught = model.statistics()
        if not taught:
            return f"module '{self.declaration.name}' has not been taught anything yet"
        names = ", ".join(c.name for c in self.declaration.inputs if c.categorical)
        asked = map(tuple, queries[:, list(model.categorical)].tolist())
        category = next((each for each in asked if each not in taught), ())
        known = ", ".join(str(each) for each in taught)
        return f"module '{self.declaration.name}' was taught nothing for ({names}) = {category}; taught: {known}"

    def checked(
        self, inputs: ArrayLike, outputs: ArrayLike, demonstrations: Sequence[str | None]
    ) -> tuple[Floats, Floats]:
        """Inputs (n, N) and outputs (n, M) as matrices that can be learned; raises as `learn` does."""
        rows = self._matrix(inputs, len(self.declaration.inputs), "inputs")
        self._matrix(rows / self._learned.model.scales, rows.shape[1], "inputs divided by their scales")
        values = self._matrix(outputs, len(self.declaration.outputs), "outputs")
        if not len(rows) == len(values) == len(demonstrations):
            raise ValueError(
                f"module '{self.declaration.name}' got {len(rows)} inputs, {len(values)} outputs and "
                f"{len(demonstrations)} demonstrations; each sample needs one of each"
            )
        return rows, values

    def _matrix(self, values: ArrayLike, components: int, what: str) -> Floats:
        """Values as rows of so many numbers that can be learned."""
        matrix = self._rows(values, components, what)
        if not np.all(np.abs(matrix) <= LARGEST):  # also false for nan
            raise ValueError(
                f"module '{self.declaration.name}': {what} must be finite numbers of magnitude up to {LARGEST:g}"
            )
        return matrix

    def _rows(self, values: ArrayLike, components: int, what: str) -> Floats:
        """Values as rows of so many numbers; what the numbers are, the learner looks at."""
        matrix = np.array(values, dtype=np.float64)
        if matrix.ndim != 2 or matrix.shape[1] != components or len(matrix) == 0:
            name = self.declaration.name
            raise ValueError(f"module '{name}': {what} must have {components} components, not shape {matrix.shape}")
        return matrix


class _Learned(NamedTuple):
    """Replaced as a whole by training."""

    model: Model
    names: list[str]
    """Of the model's groups; only ever grows, before the model knows the group."""
    size: int
    """The number of the next sample."""


_OWN = 1 << 40
"""A sample that came from no demonstration is a group of its own: this and its number."""

_FEW = 1000  # samples
_ALONE = 0.5  # in scaled inputs: the least that the largest distance counts as with one demonstration


def _groups(names: list[str], demonstrations: Sequence[str | None], numbers: Integers) -> Integers:
    """(n,) the groups of samples; demonstrations that are new are added to `names`."""
    known = {name: index for index, name in enumerate(names)}
    groups = [
        number + _OWN if shown is None else known.setdefault(shown, len(known))
        for number, shown in zip(numbers.tolist(), demonstrations, strict=True)
    ]
    names.extend(list(known)[len(names) :])
    return np.array(groups, np.int64)


def _support(calibration: Calibration, shown: int) -> Support:
    """All samples are of `shown` demonstrations."""
    largest = max(float(calibration.scores[-1]), _ALONE / math.sqrt(shown))
    return Support(median=float(np.median(calibration.scores)), largest=largest)


def warm_up() -> None:
    """Compiles (or loads from numba's cache) all kernels, so that no first query waits for the compiler."""
    inputs = np.random.default_rng(0).normal(size=(12, 2))
    for method, search in (
        ("local_quadratic", "exact"),
        ("local_linear", "exact"),
        ("kndb", "beam"),
        ("kndb2", "exact"),
        ("nearest", "beam"),
    ):
        declaration = ModuleDeclaration(
            name="warm-up",
            inputs=(Component(name="a", unit=""), Component(name="b", unit="")),
            outputs=(Output(name="c", unit=""),),
            approximator=ApproximatorSettings.model_validate({"method": method, "search": search, "neighbours": 5}),
        )
        module = Module(declaration)
        module.train(inputs, inputs[:, :1], ["one"] * 6 + ["two"] * 6)
        module.answer(inputs[0])
