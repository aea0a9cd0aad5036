"""The learner itself, in the three forms that the tables compare."""

from __future__ import annotations

import numpy as np

from benchmarks.learner.data import Floats
from benchmarks.learner.rivals import Answer, Array, Rival, Tuned
from handeye.rpt import Model, Settings, build

OUTPUTS = 1
"""How many numbers a model's answer is. Six, as an arm has joints, cost 0.1 µs more in 3-D and 0.6 µs in 16-D."""


def outputs_of(points: Floats) -> Floats:
    """(n, OUTPUTS) smooth outputs of (n, d) points, for a model to learn."""
    d = points.shape[1]
    slopes = np.random.default_rng(d).normal(size=(d, OUTPUTS)) / np.sqrt(d)
    smooth: Floats = np.tanh(points @ slopes)
    return smooth


def taught(points: Floats) -> Model:
    """A model that has learned the points, with the settings that the figures are about: KNDB2, k = 5."""
    model = Model(points.shape[1], OUTPUTS, Settings("kndb2", neighbours=5))
    model.learn(points, outputs_of(points))
    return model


class Answering(Rival):
    """handeye.rpt.Model: not neighbours only, but the output with gradient, weights and support made of them."""

    built_once = True
    slow_to_build = True

    def build(self, points: Floats) -> None:
        model = taught(points)
        self._answer, self._answers = model.answer, model.answers

    def one(self, query: Array, _k: int, /) -> Answer:
        return self._answer(query)

    def many(self, queries: Array, _k: int, /) -> Answer:
        return self._answers(queries)

    def ids_of(self, answer: Answer) -> Array:
        ids: Array = answer.ids
        return ids


class Exact(Rival):
    """handeye.rpt.Tree.exact."""

    def build(self, points: Floats) -> None:
        self._exact = build(points).exact

    def one(self, query: Array, k: int, /) -> Answer:
        return self._exact(query, k)

    many = one


class Beam(Tuned):
    """handeye.rpt.Tree.beam; the knob is its width. The tree is that of `Exact`."""

    built_once = True

    def build(self, points: Floats) -> None:
        self._tree = build(points)
        self._beam = self._tree.beam

    def set_effort(self, effort: int) -> None:
        self._width = effort

    @property
    def size(self) -> int:
        return self._tree.samples

    def one(self, query: Array, k: int, /) -> Answer:
        return self._beam(query, k, self._width)

    many = one
