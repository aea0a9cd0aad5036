"""The learner as a scikit-learn estimator: `pip install 'handeye[estimator]'`.

from handeye.rpt.estimator import RPTRegressor

regressor = RPTRegressor().fit(X, y)
regressor.predict(X_new)
print(regressor.selection_)            # what its settings were chosen from
regressor.explain(X_new).ids           # which samples each answer came from
regressor.support(X_new) > 0.05        # whether X_new is like what was taught
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

try:
    from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
    from sklearn.utils.validation import check_is_fitted, validate_data
except ImportError as error:
    raise ImportError("RPTRegressor needs scikit-learn: pip install 'handeye[estimator]'") from error

from handeye.rpt.answers import Answer
from handeye.rpt.checks import as_groups, check_finite
from handeye.rpt.model import Model
from handeye.rpt.selection import Fixed, select
from handeye.rpt.settings import METHODS, Method, Settings

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

GROWTH = 2
"""`partial_fit` chooses settings anew when there are so many times more samples than at the last choice."""

AUTO = "auto"


class RPTRegressor(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Answers from the taught samples near a query, by a Recursive Partition Tree (thesis 3.2, 3.3).

    Method, neighbours, smoothing, ridges and scales are chosen at `fit`: those that answer best for up to 256 samples
    that are left out, each alone or with its group (`handeye.rpt.selection`). Whatever a parameter fixes is not chosen.

    Args:
        method: one of `handeye.rpt.settings.METHODS`; "auto" chooses among local linear and quadratic fits and KNDB.
        neighbours: how many samples make an answer.
        smoothing: of the weights of local fits, as a share of the farthest neighbour's distance.
        scales: (N,) differences of this size count alike; "auto" chooses among standard deviations and scales by the
            outputs' response (`handeye.rpt.scaling`).
        categorical: numbers of the input components that are categories; neighbours never cross them.

    Attributes after `fit`:
        model_: the `handeye.rpt.Model` that learned; its outputs are columns even where y is a vector.
        settings_, scales_: what was chosen.
        selection_: the candidates and their errors, to print.
        n_features_in_, feature_names_in_: as in all of scikit-learn.
    """

    def __init__(
        self,
        method: Method | Literal["auto"] = "auto",
        *,
        neighbours: int | None = None,
        smoothing: float | None = None,
        scales: ArrayLike | Literal["auto"] = "auto",
        categorical: Sequence[int] | None = None,
    ) -> None:
        """Notes the parameters; `fit` checks them."""
        self.method = method
        self.neighbours = neighbours
        self.smoothing = smoothing
        self.scales = scales
        self.categorical = categorical

    def fit(self, X: ArrayLike, y: ArrayLike, groups: ArrayLike | None = None) -> Self:
        """Learns from inputs X (n, N) and outputs y (n,) or (n, M), forgetting what was learned before.

        Args:
            X: finite real numbers; a category is a number that must recur exactly.
            y: finite real numbers.
            groups: (n,) whole numbers >= 0: what belongs together, as the samples of one demonstration do. Settings,
                support and expected errors then go by leaving out whole groups.

        Raises:
            ValueError: X, y or groups is empty, not finite or of the wrong shape; a parameter is out of range.
        """
        inputs, outputs, labels = self._checked(X, y, groups, first=True)
        given = np.arange(len(inputs)) if labels is None else labels
        self.selection_ = select(inputs, outputs, given, self._categories(), self._fixed())
        self._adopt()
        self.model_ = Model(
            inputs.shape[1],
            outputs.shape[1],
            self.settings_,
            scales=self.scales_,
            categorical=self._categories(),
        )
        self.model_.learn(inputs, outputs, labels)
        self._chosen_at = self.model_.samples
        return self

    def partial_fit(self, X: ArrayLike, y: ArrayLike, groups: ArrayLike | None = None) -> Self:
        """Learns more samples; the first call is `fit`.

        Settings and scales stay until there are twice as many samples as when they were chosen; then they are chosen
        anew, and all trees built anew. Sample numbers count on from the first call.

        Raises:
            ValueError: as `fit`; nothing was learned then.
        """
        if not hasattr(self, "model_"):
            return self.fit(X, y, groups)
        inputs, outputs, labels = self._checked(X, y, groups, first=False)
        self.model_.learn(inputs, outputs, labels)
        if self.model_.samples >= GROWTH * self._chosen_at:
            self._choose_anew()
        return self

    def predict(self, X: ArrayLike) -> Floats:
        """The outputs for inputs X (q, N): (q,) or (q, M), as y was.

        Raises:
            ValueError: X is empty, not finite or of the wrong shape; nothing was learned for a category (`NotTaught`).
            sklearn.exceptions.NotFittedError: nothing was learned yet.
        """
        outputs = self.explain(X).output
        return outputs[:, 0] if self._vector else outputs

    def explain(self, X: ArrayLike) -> Answer:
        """Answers to inputs X (q, N) with all that they came from: samples, weights, gradient, support, expected error.

        Raises:
            ValueError, sklearn.exceptions.NotFittedError: as `predict`.
        """
        check_is_fitted(self)
        inputs = validate_data(self, X, dtype=np.float64, order="C", reset=False)
        return self.model_.answers(inputs)

    def support(self, X: ArrayLike) -> Floats:
        """(q,) how well inside the taught region inputs X (q, N) lie, in (0, 1]; small values warn.

        Raises:
            ValueError, sklearn.exceptions.NotFittedError: as `predict`.
        """
        return self.explain(X).support

    def _checked(
        self, X: ArrayLike, y: ArrayLike, groups: ArrayLike | None, *, first: bool
    ) -> tuple[Floats, Floats, Integers | None]:
        """Inputs (n, N), outputs (n, M) and groups (n,), once they are known to be fine."""
        inputs, outputs = validate_data(
            self, X, y, reset=first, dtype=np.float64, order="C", multi_output=True, y_numeric=True
        )
        outputs = np.asarray(outputs, dtype=np.float64)
        vector = outputs.ndim == 1
        rows = np.ascontiguousarray(outputs.reshape(len(outputs), -1))
        check_finite(inputs, "X")
        check_finite(rows, "y")
        if first:
            self._vector = vector
        elif vector != self._vector or rows.shape[1] != self.model_.outputs:
            raise ValueError(f"y has shape {outputs.shape}, unlike what was learned: {self.model_.outputs} outputs")
        labels = None if groups is None else as_groups(groups, len(inputs))
        return inputs, rows, labels

    def _categories(self) -> list[int]:
        """The categorical components, checked."""
        numbers = [] if self.categorical is None else [int(number) for number in self.categorical]
        if not set(numbers) < set(range(self.n_features_in_)):
            raise ValueError(
                f"categorical must be among the components 0 to {self.n_features_in_ - 1}, and not all of them; "
                f"got {self.categorical!r}"
            )
        return numbers

    def _fixed(self) -> Fixed:
        """What the parameters decide, checked."""
        method = None if self.method == AUTO else self.method
        if method is not None and method not in METHODS:
            raise ValueError(f"method must be {AUTO!r} or one of {', '.join(METHODS)}, not {self.method!r}")
        scales = None
        if not (isinstance(self.scales, str) and self.scales == AUTO):
            scales = np.asarray(self.scales)
            if scales.shape != (self.n_features_in_,) or scales.dtype.kind not in "iuf":
                raise ValueError(f"scales must be {AUTO!r} or {self.n_features_in_} numbers, not {self.scales!r}")
            scales = scales.astype(np.float64)
            if not np.all((scales > 0) & np.isfinite(scales)):
                raise ValueError(f"scales must be finite and above 0, not {self.scales!r}")
        if self.neighbours is not None and np.asarray(self.neighbours).dtype.kind not in "iu":
            raise ValueError(f"neighbours must be a whole number, not {self.neighbours!r}")
        chosen = {"neighbours": self.neighbours, "smoothing": self.smoothing}
        Settings(**{name: value for name, value in chosen.items() if value is not None})  # type: ignore[arg-type]
        return Fixed(method, self.neighbours, self.smoothing, scales)

    def _adopt(self) -> None:
        self.settings_, self.scales_ = self.selection_.settings, self.selection_.scales

    def _choose_anew(self) -> None:
        """Settings and scales for all that was learned, and a model that has them."""
        plain, arrays = self.model_.to_state()
        free = ~np.isin(np.arange(self.n_features_in_), self._categories())
        inputs = np.zeros((len(arrays["points"]), self.n_features_in_))
        inputs[:, free], inputs[:, ~free] = arrays["points"] * self.scales_[free], arrays["categories"]
        self.selection_ = select(inputs, arrays["outputs"], arrays["groups"], self._categories(), self._fixed())
        self._adopt()
        arrays["points"] = inputs[:, free] / self.scales_[free]
        state: dict[str, Any] = {**plain, "settings": asdict(self.settings_), "scales": self.scales_}
        self.model_ = Model.from_state(state, arrays)
        self._chosen_at = self.model_.samples
