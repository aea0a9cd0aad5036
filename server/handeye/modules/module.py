"""A module: it is taught samples, and answers queries with what near samples say, where they came from and how far to
trust it.

Samples are partitioned by their categorical components: each combination has a tree of its own, so neighbours never
cross subtasks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handeye import rpt
from handeye.modules.declaration import ApproximatorSettings, Component, ModuleDeclaration, Output
from handeye.rpt import Calibration, Model, NotTaught

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A taught sample that an answer was made from."""

    sample_id: int
    """Row of the sample in the arrays given to `Module.train`."""
    demonstration: str
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


@dataclass(frozen=True, slots=True)
class Support:
    """How far from the taught samples a query may lie, learned by leaving out whole demonstrations.

    A task needs to tell just outside the taught region from far outside, which the learner's own p-value cannot
    (docs/decisions/009). For each sample of a category its distance to the nearest sample of the *other*
    demonstrations is taken: how far one had to reach for a place that was not taught. A query's support is 1 up to the
    median of those distances, falls linearly to 1/2 at the largest, and beyond it is half the largest divided by the
    query's distance: 1/4 at twice, 1/6 at three times the largest. With a single demonstration the distances are those
    among its own samples.
    """

    median: float
    largest: float

    def of(self, distance: float) -> float:
        """The support of a query whose nearest sample lies at `distance`."""
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


class Module:
    """A declared map from inputs to outputs, learned from examples.

    `answer` may be called from several threads, also while `train` runs: it then speaks for the samples before.
    """

    def __init__(self, declaration: ModuleDeclaration) -> None:
        self.declaration = declaration
        self._learned = _Learned(self._new_model(), ())

    def train(
        self, inputs: ArrayLike, outputs: ArrayLike, demonstrations: Sequence[str]
    ) -> tuple[CategoryStatistics, ...]:
        """Learns the samples given, and only those; returns what was learned for each combination of categories.

        Args:
            inputs: (n, N) in the declared order and units; a category is a number that must recur exactly.
            outputs: (n, M) in the declared order and units.
            demonstrations: the demonstration each sample came from, n names.

        Raises:
            ValueError: shapes do not fit the declaration or each other; a value is not finite; there is no sample.
        """
        rows = self._matrix(inputs, len(self.declaration.inputs), "inputs")
        values = self._matrix(outputs, len(self.declaration.outputs), "outputs")
        if not len(rows) == len(values) == len(demonstrations):
            raise ValueError(
                f"module '{self.declaration.name}' got {len(rows)} inputs, {len(values)} outputs and "
                f"{len(demonstrations)} demonstrations; each sample needs one of each"
            )
        names = tuple(sorted(set(demonstrations)))
        model = self._new_model()
        model.learn(rows, values, [names.index(name) for name in demonstrations])
        self._learned = _Learned(model, names)
        return self.statistics()

    def statistics(self) -> tuple[CategoryStatistics, ...]:
        """What was learned, by category; empty before training."""
        model = self._learned.model
        return tuple(
            CategoryStatistics(category, each.samples, each.groups, each.tree, _support(model.calibration(category)))
            for category, each in model.statistics().items()
        )

    def answer(self, query: ArrayLike) -> Answer:
        """What the samples near the query say.

        Args:
            query: (N,) in the declared order and units.

        Raises:
            NotTaught: there are no samples of the query's category.
            ValueError: the query does not fit the declaration or is not finite.
        """
        row = self._matrix(np.atleast_2d(np.asarray(query, dtype=np.float64)), len(self.declaration.inputs), "a query")
        if len(row) != 1:
            raise ValueError(f"a query is one vector, not {len(row)}")
        model, names = self._learned
        try:
            said = model.answer(row[0])
        except NotTaught as nothing:
            raise NotTaught(self._nothing_for(row[0], model)) from nothing
        found = zip(said.ids, said.groups, said.distances, said.weights, strict=True)
        neighbours = tuple(
            Neighbour(int(number), names[group], float(distance), float(weight))
            for number, group, distance, weight in found
            if number >= 0
        )
        category = tuple(row[0, list(model.categorical)].tolist())
        support = _support(model.calibration(category)).of(neighbours[0].distance)
        return Answer(said.output, neighbours, support)

    def _new_model(self) -> Model:
        inputs, settings = self.declaration.inputs, self.declaration.approximator
        categorical = [i for i, component in enumerate(inputs) if component.categorical]
        scales = [component.scale for component in inputs]
        return Model(
            len(inputs), len(self.declaration.outputs), settings.for_model(), scales=scales, categorical=categorical
        )

    def _nothing_for(self, query: Floats, model: Model) -> str:
        taught = model.statistics()
        if not taught:
            return f"module '{self.declaration.name}' has not been taught anything yet"
        names = ", ".join(c.name for c in self.declaration.inputs if c.categorical)
        category = tuple(query[list(model.categorical)].tolist())
        known = ", ".join(str(each) for each in taught)
        return f"module '{self.declaration.name}' was taught nothing for ({names}) = {category}; taught: {known}"

    def _matrix(self, values: ArrayLike, components: int, what: str) -> Floats:
        matrix = np.array(values, dtype=np.float64)
        name = self.declaration.name
        if matrix.ndim != 2 or matrix.shape[1] != components or len(matrix) == 0:
            raise ValueError(f"module '{name}': {what} must have {components} components, not shape {matrix.shape}")
        if not np.all(np.isfinite(matrix)):
            raise ValueError(f"module '{name}': {what} must be finite numbers")
        return matrix


class _Learned(NamedTuple):
    """Replaced as a whole by training."""

    model: Model
    demonstrations: tuple[str, ...]
    """The names of the model's groups."""


def _support(calibration: Calibration) -> Support:
    return Support(median=float(np.median(calibration.scores)), largest=float(calibration.scores[-1]))


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
