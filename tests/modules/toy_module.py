"""A module of two inputs and two outputs, and what it is taught."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from handeye.modules.answers import Answers
from handeye.modules.declaration import ApproximatorSettings, Component, ModuleDeclaration, Output
from handeye.modules.module import Module

Floats = NDArray[np.float64]


QUERY = [1.0, 42.0, 0.4]


def declare(**settings: Any) -> ModuleDeclaration:
    return ModuleDeclaration(
        name="toy",
        inputs=(
            Component(name="subtask", unit="", categorical=True),
            Component(name="x", unit="px", scale=10.0),
            Component(name="y", unit="rad", scale=0.1),
        ),
        outputs=(Output(name="u", unit="rad"), Output(name="v", unit="rad")),
        approximator=ApproximatorSettings.model_validate(settings),
    )


def samples(subtask: float, n: int = 60, seed: int = 0) -> tuple[Floats, Floats, list[str]]:
    """Samples of a linear function of its own for each subtask, from six demonstrations."""
    rng = np.random.default_rng(seed)
    inputs = np.column_stack([np.full(n, subtask), rng.uniform(0, 100, n), rng.uniform(0, 1, n)])
    return inputs, right(inputs), [f"demonstration {i % 6}" for i in range(n)]


def right(inputs: Floats) -> Floats:
    s, x, y = inputs.T
    return np.column_stack([(1 + s) * x / 100 - y, 10 * s + y])


def trained(**settings: Any) -> Module:
    module = Module(declare(**settings))
    a, b = samples(0), samples(1, seed=1)
    module.train(np.concatenate([a[0], b[0]]), np.concatenate([a[1], b[1]]), a[2] + b[2])
    return module


def taught(**settings: Any) -> Module:
    """The same samples as `trained`, learned in four pieces; every seventh came from no demonstration."""
    module = Module(declare(**settings))
    for subtask, part in ((0, slice(0, 20)), (1, slice(0, 60)), (0, slice(20, 45)), (0, slice(45, 60))):
        inputs, outputs, names = samples(subtask, seed=subtask)
        shown = [None if i % 7 == 0 else name for i, name in enumerate(names)]
        module.learn(inputs[part], outputs[part], shown[part])
    return module


def same(one: Answers, other: Answers) -> None:
    for name in ("outputs", "samples", "distances", "weights"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    np.testing.assert_array_equal(shown(one), shown(other))


def shown(answers: Answers) -> NDArray[np.object_]:
    return np.array([*answers.names, None], dtype=object)[answers.demonstrations]


QUERIES = np.concatenate([samples(s, 25, seed=9)[0] for s in (0, 1, 0)])[np.random.default_rng(0).permutation(75)]
