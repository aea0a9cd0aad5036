"""The methods that handeye's learner is compared with, all with scikit-learn's interface.

Their defaults were chosen on seeds 1 and 2 of `handeye.experiments.datasets`; report figures of other seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol, Self

from numpy.typing import ArrayLike, NDArray

from handeye.experiments.baselines.backprop import BackpropRegressor
from handeye.experiments.baselines.classic import GaussianProcess, LocallyWeightedRegressor, k_nearest_neighbours
from handeye.experiments.baselines.kohonen import KohonenRegressor
from handeye.experiments.baselines.neural_gas import NeuralGasRegressor

__all__ = [
    "BASELINES",
    "BackpropRegressor",
    "Estimator",
    "GaussianProcess",
    "KohonenRegressor",
    "LocallyWeightedRegressor",
    "NeuralGasRegressor",
    "k_nearest_neighbours",
]


class Estimator(Protocol):
    """A regressor as scikit-learn defines it, as far as the experiments use one."""

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Learns from inputs (n, d) and outputs (n,) or (n, p)."""
        ...

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """The outputs for inputs (q, d)."""
        ...

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """The parameters by name."""
        ...

    def set_params(self, **params: Any) -> Self:
        """Changes parameters."""
        ...


BASELINES: Mapping[str, Callable[[], Estimator]] = {
    "k-NN": k_nearest_neighbours,
    "LWR": LocallyWeightedRegressor,
    "Gaussian process": GaussianProcess,
    "Kohonen map": KohonenRegressor,
    "neural gas": NeuralGasRegressor,
    "back-propagation": BackpropRegressor,
}
"""By name, what makes a fresh estimator with its default settings."""
