"""The back-propagation network of Appendix D."""

from __future__ import annotations

import numpy as np
from sklearn.utils import check_random_state

from handeye.experiments.baselines.base import Floats, RandomState, StandardisedRegressor, require
from handeye.experiments.baselines.kernels import backprop_pass

OUTPUT_WEIGHT = 0.5
"""Weights to the outputs start between this and its negative."""


class BackpropRegressor(StandardisedRegressor):
    """A network with one hidden layer, trained by error back-propagation (thesis 2.5.2, Appendix D).

    Logistic hidden units, linear outputs; stochastic gradient descent on the squared error with momentum, weights
    changed after each sample. The thesis gives units and cycles only; rate, momentum and initial weights are ours.

    Args:
        hidden: units in the hidden layer.
        cycles: how often each sample is presented, in a new random order each time.
        learning_rate: of the gradient descent.
        momentum: the share of a weight's last change that is added to its next one, in [0, 1).
        initial_weight: hidden weights start uniformly within plus and minus this / sqrt(d) for d inputs.
        random_state: of the initial weights and the samples' order.

    Attributes after `fit`, for standardised inputs (d) and outputs (p), biases last:
        hidden_weights_: (hidden, d + 1); output_weights_: (p, hidden + 1).
    """

    def __init__(
        self,
        hidden: int = 30,
        cycles: int = 10_000,
        learning_rate: float = 0.003,
        momentum: float = 0.9,
        initial_weight: float = 1.0,
        random_state: RandomState = None,
    ) -> None:
        self.hidden = hidden
        self.cycles = cycles
        self.learning_rate = learning_rate
        self.momentum = momentum
        self.initial_weight = initial_weight
        self.random_state = random_state

    def _learn(self, inputs: Floats, outputs: Floats) -> None:
        require(self.hidden >= 1, "hidden must be at least 1", self.hidden)
        require(self.cycles >= 1, "cycles must be at least 1", self.cycles)
        require(0 < self.learning_rate < np.inf, "learning_rate must be finite and above 0", self.learning_rate)
        require(0 <= self.momentum < 1, "momentum must be in [0, 1)", self.momentum)
        require(0 < self.initial_weight < np.inf, "initial_weight must be finite and above 0", self.initial_weight)
        random = check_random_state(self.random_state)
        n, d = inputs.shape
        reach = self.initial_weight / np.sqrt(d)
        hidden = random.uniform(-reach, reach, (self.hidden, d + 1))
        output = random.uniform(-OUTPUT_WEIGHT, OUTPUT_WEIGHT, (outputs.shape[1], self.hidden + 1))
        steps = np.zeros_like(hidden), np.zeros_like(output)
        rate, momentum = float(self.learning_rate), float(self.momentum)
        for _ in range(self.cycles):
            backprop_pass(inputs, outputs, random.permutation(n), rate, momentum, hidden, output, *steps)
        if not (np.all(np.isfinite(hidden)) and np.all(np.isfinite(output))):
            raise ValueError(f"training diverged: the learning rate {rate:g} is too high for momentum {momentum:g}")
        self.hidden_weights_, self.output_weights_ = hidden, output

    def _answer(self, inputs: Floats) -> Floats:
        totals = inputs @ self.hidden_weights_[:, :-1].T + self.hidden_weights_[:, -1]
        states = (1 + np.tanh(totals / 2)) / 2  # the logistic function, without overflow
        return np.asarray(states @ self.output_weights_[:, :-1].T + self.output_weights_[:, -1])
