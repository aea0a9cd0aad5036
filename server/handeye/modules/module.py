"""A module: it is taught samples, and answers queries with what near samples say, where they came from and how far to
trust it.

Samples are partitioned by their categorical components: each combination has a tree of its own, so neighbours never
cross subtasks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handeye import rpt
from handeye.modules.declaration import ApproximatorSettings, Component, ModuleDeclaration, Output
from handeye.rpt import approximate

Floats = NDArray[np.float64]


class NotTaught(ValueError):
    """Nothing was taught that could answer: the module has no samples, or none of the query's category."""


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

    For each sample of a category its distance to the nearest sample of the *other* demonstrations is taken: how far one
    had to reach for a place that was not taught. A query's support is 1 up to the median of those distances, falls
    linearly to 1/2 at the largest, and beyond it is half the largest divided by the query's distance: 1/4 at twice,
    1/6 at three times the largest. With a single demonstration the distances are those among its own samples.
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


@dataclass(frozen=True, slots=True, eq=False)
class _Region:
    """The samples of one combination of categories; row i of each array is sample_ids[i]."""

    tree: rpt.Tree
    outputs: Floats
    gradients: Floats | None
    sample_ids: NDArray[np.int64]
    demonstrations: tuple[str, ...]
    support: Support


class Module:
    """A declared map from inputs to outputs, learned from examples.

    `answer` may be called from several threads, also while `train` runs: it then speaks for the samples before.
    """

    def __init__(self, declaration: ModuleDeclaration) -> None:
        self.declaration = declaration
        self._categorical = np.array([component.categorical for component in declaration.inputs])
        self._scales = np.array([c.scale for c in declaration.inputs if not c.categorical])
        self._regions: dict[tuple[float, ...], _Region] = {}

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
        categories = [tuple(row) for row in rows[:, self._categorical].tolist()]
        regions = {}
        for category in sorted(set(categories)):
            ids = np.array([i for i, other in enumerate(categories) if other == category])
            names = tuple(demonstrations[i] for i in ids)
            points = rows[ids][:, ~self._categorical] / self._scales
            regions[category] = _learn(points, values[ids], ids, names, self.declaration.approximator)
        self._regions = regions
        return self.statistics()

    def statistics(self) -> tuple[CategoryStatistics, ...]:
        """What was learned, by category; empty before training."""
        return tuple(
            CategoryStatistics(
                category=category,
                samples=len(region.sample_ids),
                demonstrations=len(set(region.demonstrations)),
                tree=rpt.statistics(region.tree),
                support=region.support,
            )
            for category, region in self._regions.items()
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
        region = self._region(tuple(row[0, self._categorical].tolist()))
        settings = self.declaration.approximator
        point = row[0, ~self._categorical] / self._scales
        kept = len(region.tree.members)
        k = 1 if settings.method == "nearest" else min(settings.neighbours or kept, kept)
        search = rpt.query_exact if settings.search == "exact" else rpt.query_beam
        ids, distances = search(region.tree, point, k)
        output, weights = _approximate(point, region, ids, distances, settings)
        neighbours = tuple(
            Neighbour(int(region.sample_ids[i]), region.demonstrations[i], float(distance), float(weight))
            for i, distance, weight in zip(ids, distances, weights, strict=True)
        )
        return Answer(output, neighbours, region.support.of(float(distances[0])))

    def _region(self, category: tuple[float, ...]) -> _Region:
        regions = self._regions
        if not regions:
            raise NotTaught(f"module '{self.declaration.name}' has not been taught anything yet")
        if category not in regions:
            names = ", ".join(c.name for c in self.declaration.inputs if c.categorical)
            taught = ", ".join(str(known) for known in regions)
            raise NotTaught(
                f"module '{self.declaration.name}' was taught nothing for ({names}) = {category}; taught: {taught}"
            )
        return regions[category]

    def _matrix(self, values: ArrayLike, components: int, what: str) -> Floats:
        matrix = np.array(values, dtype=np.float64)
        name = self.declaration.name
        if matrix.ndim != 2 or matrix.shape[1] != components or len(matrix) == 0:
            raise ValueError(f"module '{name}': {what} must have {components} components, not shape {matrix.shape}")
        if not np.all(np.isfinite(matrix)):
            raise ValueError(f"module '{name}': {what} must be finite numbers")
        return matrix


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


def _learn(
    points: Floats, outputs: Floats, ids: NDArray[np.int64], names: tuple[str, ...], settings: ApproximatorSettings
) -> _Region:
    tree = rpt.build(points, keep_covered=settings.keep_covered)
    gradients = None
    if settings.method == "kndb2":
        # Gradients use every sample, also those that the tree drops.
        whole = tree if settings.keep_covered else rpt.build(points)
        gradients = approximate.estimate_gradients(
            whole,
            outputs,
            neighbours=settings.neighbours or len(points),
            smoothing=settings.smoothing,
            ridge=settings.ridge,
        )
    return _Region(tree, outputs, gradients, ids, names, _calibrate(points, names))


def _calibrate(points: Floats, names: tuple[str, ...]) -> Support:
    """`Support` from the distances of each demonstration's samples to the nearest sample of the others."""
    labels = np.array(names)
    distinct = sorted(set(names))
    reached = [np.zeros(1)]
    if len(distinct) > 1:
        reached = [
            rpt.query_exact(rpt.build(points[labels != name]), points[labels == name], 1).distances[:, 0]
            for name in distinct
        ]
    elif len(points) > 1:
        reached = [rpt.query_exact(rpt.build(points), points, 2).distances[:, 1]]
    distances = np.concatenate(reached)
    return Support(median=float(np.median(distances)), largest=float(distances.max()))


def _approximate(
    point: Floats, region: _Region, ids: NDArray[np.int64], distances: Floats, settings: ApproximatorSettings
) -> tuple[Floats, Floats]:
    """The output and the neighbours' shares in it."""
    inputs, outputs = region.tree.points[ids], region.outputs[ids]
    if settings.method == "nearest":
        return approximate.nearest(outputs), np.ones(1)
    if settings.method in ("kndb", "kndb2"):
        weights = approximate.kndb_weights(distances, alpha=settings.alpha)
        if region.gradients is None:
            return approximate.kndb(outputs, distances, alpha=settings.alpha), weights
        tangents = region.gradients[ids]
        return approximate.kndb2(point, inputs, outputs, tangents, distances, alpha=settings.alpha), weights
    weights = approximate.local_weights(distances, smoothing=settings.smoothing)
    if settings.method == "local_linear":
        return approximate.local_linear(point, inputs, outputs, weights, ridge=settings.ridge), weights
    output = approximate.local_quadratic(
        point, inputs, outputs, weights, ridge=settings.ridge, curvature_ridge=settings.curvature_ridge
    )
    return output, weights
