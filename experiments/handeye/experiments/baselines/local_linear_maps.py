"""Neurons that answer by local linear maps: what the Kohonen map and neural gas have in common."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray
from sklearn.utils import check_random_state

from handeye.experiments.baselines.base import Floats, RandomState, StandardisedRegressor, require
from handeye.experiments.baselines.kernels import answer_by_maps

Integers = NDArray[np.int64]
Ends = tuple[float, float]
"""A quantity at the beginning and at the end of training."""


class LocalLinearMaps(StandardisedRegressor):
    """A vector quantiser whose neuron s, the nearest to the input u, answers y_s + A_s (u - w_s) (thesis eq 2.1).

    In each cycle all samples are presented, one at a time, in a new random order. The neuron nearest to a sample learns
    from it, and its neighbours the less the farther they are. Rate and width of the neighbourhood fall exponentially.

    Differences from the papers: the right output is given with each input, where the papers' robot found it by moving;
    references start at random samples instead of random places; inputs and outputs are standardised.

    Args:
        neurons: how many, about; by default one for each d + 1 samples, as many as a linear map of d inputs has terms.
        cycles: how often each sample is presented.
        rates: the step towards a sample, at the beginning and at the end of training.
        final_width: the neighbourhood's width at the end; in the beginning it is half the network.
        random_state: of the references' start and the samples' order.

    Attributes after `fit`, in standardised units, for m neurons, d inputs and p outputs:
        references_: (m, d) the vectors w; outputs_: (m, p) y at w; jacobians_: (m, p, d) the matrices A.
    """

    def __init__(
        self,
        neurons: int | None = None,
        cycles: int = 200,
        rates: Ends = (0.5, 0.02),
        final_width: float = 0.2,
        random_state: RandomState = None,
    ) -> None:
        self.neurons = neurons
        self.cycles = cycles
        self.rates = rates
        self.final_width = final_width
        self.random_state = random_state

    def _learn(self, inputs: Floats, outputs: Floats) -> None:
        first, last = self.rates
        require(self.neurons is None or self.neurons >= 1, "neurons must be at least 1", self.neurons)
        require(self.cycles >= 1, "cycles must be at least 1", self.cycles)
        require(0 < last <= first <= 1, "rates must not rise, be at most 1 and above 0", self.rates)
        require(0 < self.final_width < np.inf, "final_width must be finite and above 0", self.final_width)
        random = check_random_state(self.random_state)
        n, d = inputs.shape
        m, half = self._arrange(self.neurons or max(1, n // (d + 1)), d)
        start = random.choice(n, m, replace=m > n)
        self.references_, self.outputs_ = inputs[start], outputs[start]
        self.jacobians_ = np.zeros((m, outputs.shape[1], d))
        widths = (max(half, float(self.final_width)), float(self.final_width))
        blur = float(d)  # the mean squared distance of standardised samples from their mean
        for cycle in range(self.cycles):
            span = (cycle / self.cycles, (cycle + 1) / self.cycles)
            order = random.permutation(n)
            blur = self._present(inputs, outputs, order, span, widths, (float(first), float(last)), blur)

    def _answer(self, inputs: Floats) -> Floats:
        answers = np.empty((len(inputs), self.outputs_.shape[1]))
        answer_by_maps(inputs, self.references_, self.outputs_, self.jacobians_, answers)
        return answers

    @abstractmethod
    def _arrange(self, neurons: int, dimension: int) -> tuple[int, float]:
        """Lays out about so many neurons; returns how many there are and half the network's width."""

    @abstractmethod
    def _present(
        self, inputs: Floats, outputs: Floats, order: Integers, span: Ends, widths: Ends, rates: Ends, blur: float
    ) -> float:
        """Presents all samples once; what is returned is the next cycle's blur."""
