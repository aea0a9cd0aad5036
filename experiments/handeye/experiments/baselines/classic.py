"""What people would take first: k-NN, locally weighted regression, Gaussian process."""

from __future__ import annotations

import warnings

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.neighbors import KNeighborsRegressor, NearestNeighbors
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils import check_random_state

from handeye.experiments.baselines.base import Floats, RandomState, StandardisedRegressor, require

BATCH = 1_000_000
"""So many numbers at most are gathered for local fits at a time."""

NEIGHBOURS_PER_TERM = 4
"""By default LWR fits so many neighbours for each of a linear function's d + 1 terms."""

SMALLEST_RIDGE = 1e-12
"""With less, degenerate neighbourhoods could not be solved in double precision."""


def k_nearest_neighbours() -> Pipeline:
    """scikit-learn's k-NN on standardised inputs: the 5 nearest samples, weighted by 1 / distance."""
    return make_pipeline(StandardScaler(), KNeighborsRegressor(n_neighbors=5, weights="distance"))


class LocallyWeightedRegressor(StandardisedRegressor):
    """A linear function, fitted anew around each query to its nearest samples with tricube weights.

    Source: W. S. Cleveland, "Robust locally weighted regression and smoothing scatterplots", Journal of the American
    Statistical Association 74 (1979) 829-836, without the robust iterations.

    Args:
        neighbours: how many samples are fitted, all when there are fewer; by default 4 for each of d + 1 terms.
        ridge: holds slopes that the neighbours do not determine; a share of their mean variance, at least 1e-12.

    Attributes after `fit`:
        neighbours_: the number of neighbours used.
    """

    def __init__(self, neighbours: int | None = None, ridge: float = 1e-6) -> None:
        self.neighbours = neighbours
        self.ridge = ridge

    def _learn(self, inputs: Floats, outputs: Floats) -> None:
        require(self.neighbours is None or self.neighbours >= 1, "neighbours must be at least 1", self.neighbours)
        require(SMALLEST_RIDGE <= self.ridge < np.inf, "ridge must be finite and at least 1e-12", self.ridge)
        n, d = inputs.shape
        self.neighbours_ = min(n, self.neighbours or NEIGHBOURS_PER_TERM * (d + 1))
        self.search_ = NearestNeighbors(n_neighbors=self.neighbours_).fit(inputs)
        self.samples_, self.values_ = inputs, outputs

    def _answer(self, inputs: Floats) -> Floats:
        rows = max(1, BATCH // (self.neighbours_ * (inputs.shape[1] + self.values_.shape[1])))
        return np.concatenate([self._fit_at(inputs[first : first + rows]) for first in range(0, len(inputs), rows)])

    def _fit_at(self, queries: Floats) -> Floats:
        distances, ids = self.search_.kneighbors(queries)
        # A little beyond the farthest neighbour, so that it and its equals keep a weight; never 0.
        reach = np.maximum(1.001 * distances[:, -1:], np.finfo(np.float64).tiny)
        weights = (1 - (distances / reach) ** 3) ** 3
        weights /= weights.sum(axis=1, keepdims=True)
        offsets, values = self.samples_[ids] - queries[:, np.newaxis], self.values_[ids]
        centre, mean = weights[:, np.newaxis] @ offsets, weights[:, np.newaxis] @ values
        offsets -= centre
        weighted = np.swapaxes(offsets * weights[:, :, np.newaxis], 1, 2)
        moments = weighted @ offsets
        d = queries.shape[1]
        variance = np.trace(moments, axis1=1, axis2=2) / d
        variance[variance == 0] = 1.0  # all neighbours coincide: the slopes become 0
        moments += self.ridge * variance[:, np.newaxis, np.newaxis] * np.eye(d)
        slopes = np.linalg.solve(moments, weighted @ (values - mean))
        return np.asarray((mean - centre @ slopes)[:, 0])


class GaussianProcess(StandardisedRegressor):
    """scikit-learn's Gaussian process on standardised components, with noise and a length scale for each input.

    The hyperparameters maximise the marginal likelihood; several outputs share them.

    Args:
        max_samples: of more samples a random choice is learned; time grows with their cube, memory with their square.
        random_state: of that choice.

    Attributes after `fit`:
        process_: the fitted `GaussianProcessRegressor`.
    """

    def __init__(self, max_samples: int = 2000, random_state: RandomState = None) -> None:
        self.max_samples = max_samples
        self.random_state = random_state

    def _learn(self, inputs: Floats, outputs: Floats) -> None:
        require(self.max_samples >= 1, "max_samples must be at least 1", self.max_samples)
        n, d = inputs.shape
        if n > self.max_samples:
            kept = check_random_state(self.random_state).choice(n, self.max_samples, replace=False)
            inputs, outputs = inputs[kept], outputs[kept]
        # The first length is about the distance between samples: with shorter ones all would look like noise.
        smooth = RBF(np.full(d, np.sqrt(d)), length_scale_bounds=(1e-2, 1e4))
        kernel = ConstantKernel(1.0, (1e-3, 1e6)) * smooth + WhiteKernel(1e-3, (1e-10, 10.0))
        self.process_ = GaussianProcessRegressor(kernel)
        with warnings.catch_warnings():
            # A length at its upper bound is what an irrelevant input should get, noise at its lower bound none at all.
            warnings.simplefilter("ignore", ConvergenceWarning)
            self.process_.fit(inputs, outputs)

    def _answer(self, inputs: Floats) -> Floats:
        return np.asarray(self.process_.predict(inputs)).reshape(len(inputs), -1)
