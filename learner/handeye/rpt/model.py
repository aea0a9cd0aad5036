"""A map from inputs to outputs, learned from samples: what most users of this library want.

Inputs may mix units: each component is divided by a scale of its own before any distance is taken. Categorical
components partition: each combination of their values has a tree of its own, so neighbours never cross them.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, NamedTuple, Self

import numpy as np
from numpy import empty
from numpy.typing import ArrayLike, NDArray

from handeye.rpt.answers import Answer, MixedAnswer
from handeye.rpt.calibration import Calibration
from handeye.rpt.checks import as_groups, as_radii, as_rows
from handeye.rpt.given import given_gradients
from handeye.rpt.kernels.answer import ANSWERED, NOT_FINITE, answer_one
from handeye.rpt.region import TANGENTS, Region, Samples, with_room
from handeye.rpt.settings import Settings
from handeye.rpt.structure import Statistics
from handeye.rpt.tree import Tree

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Category = tuple[float, ...]


class NotTaught(ValueError):
    """There is no sample that could answer: none at all, or none of the query's category."""


class RegionStatistics(NamedTuple):
    """What was learned for one combination of categories."""

    samples: int
    groups: int
    tree: Statistics
    calibrated: int
    """How many samples were left out and asked for (`Calibration`)."""


class Model:
    """Learns from samples and answers queries; both may go on at once in several threads.

    A query answers for the samples learned when it began; removal counts at once. Queries never wait for anything.
    """

    def __init__(
        self,
        components: int,
        outputs: int,
        settings: Settings | None = None,
        *,
        scales: ArrayLike | None = None,
        categorical: Sequence[int] = (),
        radii: ArrayLike | None = None,
    ) -> None:
        """Declares the map.

        Args:
            components: N, how many input components there are, categorical ones included.
            outputs: M, how many output components.
            settings: how answers are made.
            scales: (N,) differences of this size count alike across components; 1 when not given. Without meaning for
                categorical components.
            categorical: numbers of the input components that are categories.
            radii: T(1) > ... > T(L) of the trees, in units of the scales; derived from the data when not given.

        Raises:
            ValueError: a number is out of range, or no component is left that is not a category.
        """
        self.settings = settings or Settings()
        self.components, self.outputs = components, outputs
        self.radii = None if radii is None else as_radii(radii)
        if components < 1 or outputs < 1:
            raise ValueError(f"a model needs at least one input and one output, not {components} and {outputs}")
        self._categorical = np.zeros(components, np.bool_)
        if any(not 0 <= number < components for number in categorical):
            raise ValueError(f"categorical components must be among 0 to {components - 1}, not {list(categorical)}")
        self._categorical[list(categorical)] = True
        if self._categorical.all():
            raise ValueError("a model needs an input component that is not a category")
        self.scales = np.ones(components) if scales is None else np.array(scales, dtype=np.float64)
        if self.scales.shape != (components,) or not np.all((self.scales > 0) & np.isfinite(self.scales)):
            raise ValueError(f"scales must be {components} finite numbers above 0, not {scales!r}")
        self._factors = 1 / self.scales[~self._categorical]
        self._learning = threading.Lock()
        self._regions: dict[Category, Region] = {}
        self._only: Region | None = None
        self._size = 0
        self._places = np.zeros((0, 2), np.int64)
        self._made: list[Region] = []

    @property
    def samples(self) -> int:
        """How many samples can answer."""
        return sum(region.tree.samples for region in self._regions.values())

    @property
    def categorical(self) -> tuple[int, ...]:
        """Numbers of the input components that are categories."""
        return tuple(np.flatnonzero(self._categorical).tolist())

    def learn(
        self,
        inputs: ArrayLike,
        outputs: ArrayLike,
        groups: ArrayLike | None = None,
        *,
        derived: tuple[ArrayLike, ArrayLike] | None = None,
        gradients: ArrayLike | None = None,
    ) -> Integers:
        """Adds samples; the next query knows them.

        The first samples of a category are built into a tree at once, later ones inserted one by one; `repair` after
        many of them.

        Args:
            inputs: (n, N); a category is a number that must recur exactly.
            outputs: (n, M).
            groups: (n,) whole numbers >= 0: what belongs together, as the samples of one demonstration do. Support and
                expected errors are calibrated leaving out whole groups. Each sample is its own group when not given.
            derived: derived points around each sample, inputs (n, K, N) and outputs (n, K, M): its linear map is fitted
                to them (4.1.2) instead of to neighbours. For methods `leaf_map` and `kndb2`.
            gradients: (n, M, N) in place of derived points, where the derivatives are known.

        Returns:
            (n,) the samples' numbers, counted from 0 in the order they came.

        Raises:
            ValueError: shapes do not fit, or a value is not finite; nothing was learned then.
        """
        rows = as_rows(inputs, self.components, "inputs")
        values = as_rows(outputs, self.outputs, "outputs")
        n = len(rows)
        if len(values) != n:
            raise ValueError(f"each sample needs an input and an output; got {n} inputs and {len(values)} outputs")
        labels = None if groups is None else as_groups(groups, n)
        if self.settings.method not in TANGENTS and not (derived is None and gradients is None):
            raise ValueError(f"method {self.settings.method} uses no gradients; {' and '.join(TANGENTS)} do")
        free = ~self._categorical
        maps = given_gradients(rows, values, derived, gradients, free, self._factors)
        points = rows[:, free] * self._factors
        with self._learning:
            numbers = np.arange(self._size, self._size + n)
            labels = -1 - numbers if labels is None else labels
            self._take(rows[:, self._categorical], Samples(points, values, labels, numbers, maps))
        return numbers

    def forget(self, numbers: ArrayLike) -> None:
        """Takes samples out, by the numbers that `learn` returned; the next query does not know them.

        Raises:
            ValueError: a number is unknown, given twice, or was forgotten before; nothing was forgotten then.
        """
        chosen = np.atleast_1d(np.asarray(numbers))
        if chosen.size == 0:
            return
        if chosen.dtype.kind not in "iu" or chosen.ndim != 1:
            raise ValueError(f"samples are forgotten by whole numbers, not by {chosen.dtype} of shape {chosen.shape}")
        with self._learning:
            known = (chosen >= 0) & (chosen < self._size)
            if not known.all() or len(np.unique(chosen)) < len(chosen) or not self._alive()[chosen].all():
                raise ValueError(
                    f"samples can be forgotten once and must be among 0 to {self._size - 1}; got {chosen.tolist()[:10]}"
                )
            places = self._places[chosen]
            for index in np.unique(places[:, 0]):
                self._made[index].forget(places[places[:, 0] == index, 1])

    def forget_group(self, group: int) -> Integers:
        """Takes a whole group (demonstration) out; returns the numbers of its samples.

        Raises:
            ValueError: no sample belongs to it.
        """
        regions = [region.living() for region in self._regions.values() if region.tree.samples]
        numbers = np.sort(np.concatenate([np.zeros(0, np.int64), *(s.numbers[s.groups == group] for s in regions)]))
        if not len(numbers):
            raise ValueError(f"no sample belongs to group {group}")
        self.forget(numbers)
        return numbers

    def repair(self) -> None:
        """Builds all trees anew from the samples left and estimates all gradients again (`Tree.repair`)."""
        with self._learning:
            for region in self._regions.values():
                if region.tree.samples:
                    region.repair()

    def answer(self, query: ArrayLike) -> Answer:
        """What the samples near one query (N,) say; fastest for a contiguous float64 array.

        Raises:
            NotTaught: there is no sample, or none of the query's category.
            ValueError: the query does not fit or is not finite.
        """
        if self._only is not None:
            # The way of a controller that asks again and again: no conversion, no copy, one call into compiled code.
            numbers, length, source, _ = self._only.state
            row = empty(length)
            try:
                if answer_one(query, numbers, row) == ANSWERED:
                    return Answer(row, source)
            except (TypeError, AttributeError):
                pass  # no contiguous array of float64
        vector = np.asarray(query)
        if vector.ndim != 1:
            raise ValueError(f"one query is a vector of {self.components} components, not of shape {vector.shape}")
        answers = self._answer(as_rows(vector, self.components, "the query"))
        return Answer(answers._rows[0], answers._source)

    def answers(self, queries: ArrayLike) -> Answer:
        """What the samples near each of several queries (q, N) say.

        Raises:
            NotTaught: there is no sample, or none of a query's category.
            ValueError: the queries do not fit or are not finite.
        """
        rows = as_rows(queries, self.components, "queries")
        if np.ndim(queries) != 2:
            raise ValueError(f"several queries are a (q, {self.components}) array, not of shape {np.shape(queries)}")
        return self._answer(rows)

    def statistics(self) -> dict[Category, RegionStatistics]:
        """What was learned, by category; () where there are none."""
        return {
            category: RegionStatistics(
                region.tree.samples,
                len(np.unique(region.groups[region.tree.alive])),
                region.tree.statistics(),
                len(region.calibration.residuals),
            )
            for category, region in sorted(self._regions.items())
            if region.tree.samples
        }

    def tree(self, category: Category = ()) -> Tree:
        """The tree over the scaled inputs of one category, to look at.

        Raises:
            NotTaught: there is none.
        """
        return self._region(category).tree

    def calibration(self, category: Category = ()) -> Calibration:
        """What support and expected errors of one category go by.

        Raises:
            NotTaught: nothing was learned there.
        """
        return self._region(category).calibration

    def to_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """All that `from_state` needs: plain values, and arrays with a row for each living sample."""
        categories = [category for category, region in self._regions.items() if region.tree.samples]
        living = [self._regions[category].living() for category in categories]
        p, d = self.outputs, len(self._factors)
        none = np.zeros(0, np.int64)
        nothing = Samples(np.zeros((0, d)), np.zeros((0, p)), none, none, None)
        parts = [nothing, *living]
        order = np.argsort(np.concatenate([part.numbers for part in parts]))
        maps = [np.full((len(s.points), p, d), np.nan) if s.maps is None else s.maps for s in parts]
        rows = [np.zeros((0, len(self.categorical)))]
        rows += [np.tile(category, (len(s.points), 1)) for category, s in zip(categories, living, strict=True)]
        plain = {
            "components": self.components,
            "outputs": self.outputs,
            "settings": asdict(self.settings),
            "scales": self.scales.tolist(),
            "categorical": list(self.categorical),
            "radii": None if self.radii is None else self.radii.tolist(),
            "size": self._size,
        }
        arrays = {
            "categories": np.concatenate(rows)[order],
            "points": np.concatenate([part.points for part in parts])[order],
            "outputs": np.concatenate([part.outputs for part in parts])[order],
            "groups": np.concatenate([part.groups for part in parts])[order],
            "numbers": np.concatenate([part.numbers for part in parts])[order],
            "maps": np.concatenate(maps)[order],
        }
        return plain, arrays

    @classmethod
    def from_state(cls, plain: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Self:
        """A model that answers as the one whose `to_state` this is, its trees built anew.

        Raises:
            ValueError: the parts do not fit together.
        """
        model = cls(
            int(plain["components"]),
            int(plain["outputs"]),
            Settings(**plain["settings"]),
            scales=plain["scales"],
            categorical=plain["categorical"],
            radii=plain["radii"],
        )
        d, p = len(model._factors), model.outputs
        numbers, groups = np.asarray(arrays["numbers"], np.int64), np.asarray(arrays["groups"], np.int64)
        points, outputs = as_rows(arrays["points"], d, "points"), as_rows(arrays["outputs"], p, "outputs")
        categories = as_rows(arrays["categories"], len(model.categorical), "categories")
        maps = np.array(arrays["maps"], np.float64)
        n, size = len(points), int(plain["size"])
        lengths = {len(outputs), len(categories), len(numbers), len(groups), len(maps)}
        if lengths != {n} or maps.shape[1:] != (p, d) or np.isinf(maps).any():
            raise ValueError(f"the arrays do not fit together: {n} points, other lengths {sorted(lengths)}")
        if n and not (numbers[0] >= 0 and numbers[-1] < size and np.all(np.diff(numbers) > 0)):
            raise ValueError(f"sample numbers must ascend from 0 to {size - 1} at most")
        model._take(categories, Samples(points, outputs, groups, numbers, maps))
        model._places = with_room(model._places, model._size, size - model._size)
        model._places[model._size : size] = -1
        model._size = size
        return model

    def __getstate__(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        return self.to_state()

    def __setstate__(self, state: tuple[dict[str, Any], dict[str, NDArray[Any]]]) -> None:
        self.__dict__.update(type(self).from_state(*state).__dict__)

    def _take(self, categories: Floats, samples: Samples) -> None:
        """Gives samples to the regions of their categories (n, c)."""
        if not len(samples.points):
            return
        size = int(samples.numbers[-1]) + 1
        self._places = with_room(self._places, self._size, size - self._size)
        self._places[self._size : size, 0] = -1
        regions = dict(self._regions)
        for category, chosen in _by_category(categories):
            part = samples if len(chosen) == len(samples.points) else samples.chosen(chosen)
            region = regions.get(category)
            if region is not None and region.tree.samples:
                local = region.learn(part)
            else:
                components = (np.flatnonzero(~self._categorical), self.components)
                region = Region(part, self.settings, self._factors, components, self.radii)
                regions[category] = region
                self._made.append(region)
                local = np.arange(len(chosen))
            self._places[part.numbers, 0] = self._made.index(region)
            self._places[part.numbers, 1] = local
        self._size = size
        self._only = None if self._categorical.any() else regions[()]
        self._regions = regions

    def _alive(self) -> NDArray[np.bool_]:
        """(size,) which numbers belong to living samples."""
        alive = np.zeros(self._size, np.bool_)
        for index, region in enumerate(self._made):
            mine = np.flatnonzero(self._places[: self._size, 0] == index)
            alive[mine] = region.tree.alive[self._places[mine, 1]]
        return alive

    def _answer(self, rows: Floats) -> Answer:
        answers, places = [], []
        for category, chosen in _by_category(rows[:, self._categorical]):
            queries = np.ascontiguousarray(rows[np.ix_(chosen, ~self._categorical)])
            outcome, answer = self._region(category).answers(queries)
            if outcome == NOT_FINITE:
                raise ValueError("a query is too far away to be squared once it is scaled")
            if outcome != ANSWERED:
                raise NotTaught(self._nothing_for(category))
            answers.append(answer)
            places.append(chosen)
        return answers[0] if len(answers) == 1 else MixedAnswer(answers, places)

    def _region(self, category: Category) -> Region:
        regions = self._regions
        if category not in regions or not regions[category].tree.samples:
            raise NotTaught(self._nothing_for(category))
        return regions[category]

    def _nothing_for(self, category: Category) -> str:
        taught = [str(known) for known, region in self._regions.items() if region.tree.samples]
        if not taught:
            return "nothing has been learned yet"
        return f"nothing was learned for category {category}; learned: {', '.join(taught)}"


def _by_category(categories: Floats) -> list[tuple[Category, Integers]]:
    """Each combination that occurs in (n, c), with the rows where it does."""
    if categories.shape[1] == 0:
        return [((), np.arange(len(categories)))]
    distinct, inverse = np.unique(categories, axis=0, return_inverse=True)
    places = inverse.reshape(-1)
    return [(tuple(row), np.flatnonzero(places == i)) for i, row in enumerate(distinct.tolist())]
