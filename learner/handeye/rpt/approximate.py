"""What an output is, given the samples retrieved near a query (thesis 3.3).

Shapes: k neighbours, nearest first; d input components; p output components. A gradient is a (p, d) matrix of the
derivatives of the outputs by the inputs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handeye.rpt.kernels import fit
from handeye.rpt.kernels.answer import EPSILON
from handeye.rpt.settings import SMALLEST_RIDGE
from handeye.rpt.tree import Tree

Floats = NDArray[np.float64]


def nearest(outputs: ArrayLike) -> Floats:
    """The output of the nearest neighbour: the first row of outputs (k, p)."""
    return np.array(_matrix(outputs, "outputs")[0])


def kndb_weights(distances: ArrayLike, *, alpha: float, epsilon: float = EPSILON) -> Floats:
    """KNDB's weights w_j / w with w_j = alpha^(-|Q - Q_j| / (epsilon + |Q - Q_1|)), shape (k,); they add up to 1.

    Args:
        distances: (k,) from the query, nearest first.
        alpha: at least 1; the larger, the more the nearest neighbours decide.
        epsilon: above 0.

    Raises:
        ValueError: alpha or epsilon is out of range, or distances are empty, negative or not sorted.
    """
    sorted_distances = _distances(distances)
    if not (1 <= alpha < np.inf and epsilon > 0):
        raise ValueError(f"KNDB needs a finite alpha >= 1 and epsilon > 0, not alpha {alpha} and epsilon {epsilon}")
    # Counted from the nearest one, whose weight becomes 1, so that the weights cannot all vanish.
    exponents = (sorted_distances - sorted_distances[0]) / (epsilon + sorted_distances[0])
    weights = np.exp(-np.log(alpha) * exponents)
    return np.asarray(weights / weights.sum())


def kndb(outputs: ArrayLike, distances: ArrayLike, *, alpha: float, epsilon: float = EPSILON) -> Floats:
    """KNDB: the neighbours' outputs (k, p), weighted by `kndb_weights`; shape (p,).

    Raises:
        ValueError: as `kndb_weights`, or the shapes do not fit.
    """
    return np.asarray(kndb_weights(distances, alpha=alpha, epsilon=epsilon) @ _matrix(outputs, "outputs"))


def kndb2(
    query: ArrayLike,
    inputs: ArrayLike,
    outputs: ArrayLike,
    gradients: ArrayLike,
    distances: ArrayLike,
    *,
    alpha: float,
    epsilon: float = EPSILON,
) -> Floats:
    """KNDB2: like KNDB, but each neighbour speaks for the query by its own tangent, O_j + grad f(Q_j) (Q - Q_j).

    Args:
        query: (d,).
        inputs: (k, d) the neighbours.
        outputs: (k, p) theirs.
        gradients: (k, p, d) theirs, as `estimate_gradients` gives them.
        distances: (k,) from the query, nearest first.
        alpha: as for `kndb_weights`.
        epsilon: as for `kndb_weights`.

    Raises:
        ValueError: as `kndb_weights`, or the shapes do not fit.
    """
    steps = np.asarray(query, dtype=np.float64) - _matrix(inputs, "inputs")
    tangents = _matrix(outputs, "outputs") + np.einsum("kpd,kd->kp", np.asarray(gradients, dtype=np.float64), steps)
    return np.asarray(kndb_weights(distances, alpha=alpha, epsilon=epsilon) @ tangents)


def local_weights(distances: ArrayLike, *, smoothing: float) -> Floats:
    """Weights of the local fits, w_j proportional to 1 / (D_j^2 + (smoothing D_k)^2), shape (k,); they add up to 1.

    D_k is the distance of the farthest neighbour: smoothing keeps a sample at the query from deciding alone.

    Raises:
        ValueError: smoothing is not above 0, or distances are empty, negative or not sorted.
    """
    sorted_distances = _distances(distances)
    if not 0 < smoothing < np.inf:
        raise ValueError(f"smoothing must be above 0 and finite, not {smoothing}")
    farthest = sorted_distances[-1]
    if farthest == 0:
        return np.full(len(sorted_distances), 1 / len(sorted_distances))
    weights = 1 / ((sorted_distances / farthest) ** 2 + smoothing**2)
    return np.asarray(weights / weights.sum())


def local_linear(
    query: ArrayLike, inputs: ArrayLike, outputs: ArrayLike, weights: ArrayLike, *, ridge: float
) -> Floats:
    """The output at the query, (p,), of a linear function fitted to the neighbours.

    Weighted least squares with a free constant and a ridge on the slopes: where the neighbours do not determine a slope
    it becomes small instead of wild.

    Args:
        query: (d,).
        inputs: (k, d) the neighbours.
        outputs: (k, p) theirs.
        weights: (k,) theirs, not negative and not all zero, as `local_weights` gives them.
        ridge: at least 1e-12, as a share of the mean variance of the neighbours' input components.

    Raises:
        ValueError: the ridge is too small, the weights do not serve, or the shapes do not fit.
    """
    return _local_fit(query, inputs, outputs, weights, 1, ridge, ridge)[0]


def local_quadratic(
    query: ArrayLike,
    inputs: ArrayLike,
    outputs: ArrayLike,
    weights: ArrayLike,
    *,
    ridge: float,
    curvature_ridge: float,
) -> Floats:
    """As `local_linear` with a quadratic function; curvature_ridge is the ridge on its second-order terms."""
    return _local_fit(query, inputs, outputs, weights, 2, ridge, curvature_ridge)[0]


def estimate_gradients(tree: Tree, outputs: ArrayLike, *, neighbours: int, smoothing: float, ridge: float) -> Floats:
    """KNDB2's gradients, (n, p, d): at each sample the slopes of a local linear fit to its nearest samples.

    Args:
        tree: over the n samples; all of them must be kept in it.
        outputs: (n, p) theirs.
        neighbours: how many samples are fitted, the sample itself among them; all when there are fewer.
        smoothing: as for `local_weights`.
        ridge: as for `local_linear`.

    Raises:
        ValueError: as `local_linear`; the tree has dropped samples; outputs do not fit the tree.
    """
    values = _matrix(outputs, "outputs")
    n, d = tree.points.shape
    if len(values) != n or tree.samples != n:
        raise ValueError(
            f"gradients need an output for each sample and a tree that keeps every sample; got {len(values)} outputs, "
            f"{n} samples and {tree.samples} kept"
        )
    ids, distances = tree.exact(tree.points, min(neighbours, n))
    gradients = np.zeros((n, values.shape[1], d))
    for i in range(n):
        weights = local_weights(distances[i], smoothing=smoothing)
        gradients[i] = _local_fit(tree.points[i], tree.points[ids[i]], values[ids[i]], weights, 1, ridge, ridge)[1]
    return gradients


def leaf_map(
    sample: ArrayLike, output: ArrayLike, derived_inputs: ArrayLike, derived_outputs: ArrayLike, *, ridge: float = 1e-9
) -> Floats:
    """The linear map of a leaf from derived points around its sample, (p, d); U_D - U_P = T (V_D - V_P) (4.1.2).

    Args:
        sample: (d,) V_P.
        output: (p,) U_P.
        derived_inputs: (K, d) V_D; the thesis takes K = 2 d of them, at about the radius of the leaf's level.
        derived_outputs: (K, p) U_D.
        ridge: at least 1e-12, as a share of the offsets' mean square: directions without a derived point get no slope.

    Raises:
        ValueError: the shapes do not fit or the ridge is too small.
    """
    at, said = np.ascontiguousarray(sample, dtype=np.float64), np.ascontiguousarray(output, dtype=np.float64)
    inputs, outputs = _matrix(derived_inputs, "derived_inputs"), _matrix(derived_outputs, "derived_outputs")
    if at.shape != inputs.shape[1:] or said.shape != outputs.shape[1:] or len(inputs) != len(outputs):
        raise ValueError(
            f"shapes do not fit: sample {at.shape}, output {said.shape}, derived inputs {inputs.shape}, derived "
            f"outputs {outputs.shape}"
        )
    _check_ridge(ridge)
    slope = np.zeros((len(said), len(at)))
    fit.leaf_map(at, said, inputs, outputs, ridge, slope)
    return slope


def _local_fit(
    query: ArrayLike,
    inputs: ArrayLike,
    outputs: ArrayLike,
    weights: ArrayLike,
    degree: int,
    ridge: float,
    curvature_ridge: float,
) -> tuple[Floats, Floats]:
    centre = np.ascontiguousarray(query, dtype=np.float64)
    near, values = _matrix(inputs, "inputs"), _matrix(outputs, "outputs")
    shares = np.ascontiguousarray(weights, dtype=np.float64)
    if not (len(near) == len(values) == len(shares) and centre.shape == near.shape[1:] and shares.ndim == 1):
        raise ValueError(
            f"shapes do not fit: query {centre.shape}, inputs {near.shape}, outputs {values.shape}, "
            f"weights {shares.shape}"
        )
    if not (np.all(shares >= 0) and 0 < shares.sum() < np.inf):
        raise ValueError("weights must not be negative and not all zero")
    _check_ridge(ridge, curvature_ridge)
    value, slope = np.zeros(values.shape[1]), np.zeros((values.shape[1], near.shape[1]))
    fit.local_fit(centre, near, values, shares, degree, ridge, curvature_ridge, value, slope)
    return value, slope


def _check_ridge(*ridges: float) -> None:
    for ridge in ridges:
        if not SMALLEST_RIDGE <= ridge < np.inf:
            raise ValueError(f"a ridge must be finite and at least {SMALLEST_RIDGE:g}, not {ridge}")


def _matrix(values: ArrayLike, name: str) -> Floats:
    matrix = np.ascontiguousarray(values, dtype=np.float64)
    if matrix.ndim != 2 or len(matrix) == 0:
        raise ValueError(f"{name} must be a (neighbours, components) array with at least one row, not {matrix.shape}")
    return matrix


def _distances(distances: ArrayLike) -> Floats:
    values = np.asarray(distances, dtype=np.float64)
    if values.ndim != 1 or values.size == 0 or not (values[0] >= 0 and np.all(np.diff(values) >= 0)):
        raise ValueError("distances must be one row of numbers >= 0, nearest first")
    return values
