"""What the baselines of our own share: validation by scikit-learn, standardised components, one or several outputs."""

from __future__ import annotations

from abc import abstractmethod
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

Floats = NDArray[np.float64]
RandomState = int | np.random.RandomState | None
"""What scikit-learn draws random numbers from; an integer makes `fit` repeatable."""


class StandardisedRegressor(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """A regressor on components of zero mean and unit variance; a method fills in `_learn` and `_answer`.

    Inputs may mix pixels and radians: as they are, the component with the largest numbers would decide alone.

    Attributes after `fit`, for d inputs and p outputs:
        input_mean_, input_scale_: (d,); output_mean_, output_scale_: (p,).
        output_shape_: () or (p,), the shape of one answer.
    """

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Learns from inputs X (n, d) and outputs y (n,) or (n, p).

        Raises:
            ValueError: X or y is empty, not finite or of the wrong shape; a parameter is out of range.
        """
        inputs, outputs = validate_data(self, X, y, dtype=np.float64, order="C", multi_output=True, y_numeric=True)
        self.output_shape_ = outputs.shape[1:]
        rows = np.asarray(outputs, dtype=np.float64).reshape(len(outputs), -1)
        self.input_mean_, self.input_scale_ = _moments(inputs)
        self.output_mean_, self.output_scale_ = _moments(rows)
        self._learn((inputs - self.input_mean_) / self.input_scale_, (rows - self.output_mean_) / self.output_scale_)
        return self

    def predict(self, X: ArrayLike) -> Floats:
        """The outputs for inputs X (q, d): (q,) or (q, p), as y was.

        Raises:
            ValueError: X is empty, not finite or of the wrong shape.
            sklearn.exceptions.NotFittedError: nothing was learned yet.
        """
        check_is_fitted(self)
        inputs = validate_data(self, X, dtype=np.float64, order="C", reset=False)
        answers = self._answer((inputs - self.input_mean_) / self.input_scale_)
        return np.asarray(answers * self.output_scale_ + self.output_mean_).reshape(len(inputs), *self.output_shape_)

    @abstractmethod
    def _learn(self, inputs: Floats, outputs: Floats) -> None:
        """Learns from standardised inputs (n, d) and outputs (n, p)."""

    @abstractmethod
    def _answer(self, inputs: Floats) -> Floats:
        """The standardised outputs (q, p) for standardised inputs (q, d)."""


def require(fulfilled: bool, rule: str, value: object) -> None:
    """Checks a parameter: raises a ValueError with the rule and the value unless the rule is fulfilled."""
    if not fulfilled:
        raise ValueError(f"{rule}, not {value}")


def _moments(values: Floats) -> tuple[Floats, Floats]:
    """Mean and standard deviation of each component; 1 for a constant one, so that it can be divided by."""
    spread = values.std(axis=0)
    return values.mean(axis=0), np.where(spread > 0, spread, 1.0)
