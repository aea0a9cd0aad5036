"""The learning rules against the same rules written plainly."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from handeye.experiments.baselines import kernels

Floats = NDArray[np.float64]
Maps = tuple[Floats, Floats, Floats]

RATES, WIDTHS, SPAN, BLUR = (0.5, 0.02), (2.0, 0.3), (0.2, 0.6), 0.3


def samples(n: int = 12) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(0)
    return rng.normal(size=(n, 3)), rng.normal(size=(n, 2))


def random_maps(neurons: int = 8) -> Maps:
    rng = np.random.default_rng(1)
    return rng.normal(size=(neurons, 3)), rng.normal(size=(neurons, 2)), rng.normal(size=(neurons, 2, 3))


def plain_pass(maps: Maps, order: NDArray[np.int64], shares: str, hops: Floats) -> float:
    """One pass of either method in plain numpy; the mean squared distance of the winners."""
    references, outputs, slopes = maps
    inputs, values = samples(len(order))
    squares = []
    for t, i in enumerate(order):
        progress = SPAN[0] + (SPAN[1] - SPAN[0]) * t / len(order)
        rate, width = (first * (last / first) ** progress for first, last in (RATES, WIDTHS))
        distances = ((inputs[i] - references) ** 2).sum(axis=1)
        squares.append(distances.min())
        if shares == "lattice":
            share = np.exp(-hops[distances.argmin()] / (2 * width**2))
        else:
            share = np.exp(-distances.argsort().argsort() / width)
        for r in np.flatnonzero(share > kernels.NEGLIGIBLE):
            step, offset = rate * share[r], inputs[i] - references[r]
            error = values[i] - outputs[r] - slopes[r] @ offset
            slopes[r] += step * np.outer(error, offset) / (offset @ offset + BLUR)
            outputs[r] += step * error + slopes[r] @ (step * offset)
            references[r] += step * offset
    return float(np.mean(squares))


@pytest.mark.parametrize("method", ["lattice", "rank"])
def test_a_pass_is_the_papers_rule(method: str) -> None:
    inputs, values = samples()
    order = np.random.default_rng(2).permutation(len(inputs))
    hops = ((np.indices((2, 4)).reshape(2, 8, 1) - np.indices((2, 4)).reshape(2, 1, 8)) ** 2).sum(axis=0).astype(float)
    plain, fast = random_maps(), random_maps()
    expected = plain_pass(plain, order, method, hops)
    if method == "lattice":
        blur = kernels.kohonen_pass(inputs, values, order, SPAN, hops, WIDTHS, RATES, BLUR, *fast)
    else:
        blur = kernels.gas_pass(inputs, values, order, SPAN, WIDTHS, RATES, BLUR, *fast)
    assert blur == pytest.approx(expected)
    for ours, theirs in zip(fast, plain, strict=True):
        assert ours == pytest.approx(theirs)
    assert not np.allclose(fast[2], random_maps()[2])


def test_answers_are_those_of_the_nearest_neurons_map() -> None:
    inputs, _ = samples()
    references, outputs, slopes = random_maps()
    answers = np.empty((len(inputs), 2))
    kernels.answer_by_maps(inputs, references, outputs, slopes, answers)
    for x, answer in zip(inputs, answers, strict=True):
        s = int(np.argmin(np.linalg.norm(references - x, axis=1)))
        assert answer == pytest.approx(outputs[s] + slopes[s] @ (x - references[s]))


def squared_error(hidden: Floats, output: Floats, x: Floats, y: Floats) -> float:
    """Half the squared error of the network for one sample (thesis eq 2.8)."""
    states = 1 / (1 + np.exp(-(hidden @ np.append(x, 1))))
    return float(((y - output @ np.append(states, 1)) ** 2).sum() / 2)


def gradient(weights: Floats, others: Floats, x: Floats, y: Floats, *, of_hidden: bool) -> Floats:
    """By central differences."""
    slopes = np.empty_like(weights)
    for place in np.ndindex(weights.shape):
        errors = []
        for change in (1e-6, -1e-6):
            moved = weights.copy()
            moved[place] += change
            errors.append(squared_error(*((moved, others) if of_hidden else (others, moved)), x, y))
        slopes[place] = (errors[0] - errors[1]) / 2e-6
    return slopes


def test_back_propagation_descends_the_gradient_with_momentum() -> None:
    inputs, values = samples(2)
    rng = np.random.default_rng(3)
    hidden, output = rng.normal(size=(4, 4)), rng.normal(size=(2, 5))
    fast = hidden.copy(), output.copy(), np.zeros_like(hidden), np.zeros_like(output)
    kernels.backprop_pass(inputs, values, np.array([1, 0]), 0.1, 0.7, *fast)
    steps = np.zeros_like(hidden), np.zeros_like(output)
    for i in (1, 0):
        slope = gradient(hidden, output, inputs[i], values[i], of_hidden=True)
        output_slope = gradient(output, hidden, inputs[i], values[i], of_hidden=False)
        steps = 0.7 * steps[0] - 0.1 * slope, 0.7 * steps[1] - 0.1 * output_slope
        hidden, output = hidden + steps[0], output + steps[1]
    for ours, expected in zip(fast, (hidden, output, *steps), strict=True):
        assert ours == pytest.approx(expected, abs=1e-7)
