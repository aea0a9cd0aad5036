"""Gradients that a teacher gives: as they are, or as derived points around each sample (thesis 4.1.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handeye.rpt import approximate
from handeye.rpt.checks import check_finite

Floats = NDArray[np.float64]


def given_gradients(
    inputs: Floats,
    outputs: Floats,
    derived: tuple[ArrayLike, ArrayLike] | None,
    gradients: ArrayLike | None,
    free: NDArray[np.bool_],
    factors: Floats,
) -> Floats | None:
    """What `Model.learn` is given, as (n, M, d) derivatives by the d scaled inputs; None when nothing is.

    Args:
        inputs: (n, N) the samples'.
        outputs: (n, M) theirs.
        derived: inputs (n, K, N) and outputs (n, K, M) of derived points, or None.
        gradients: (n, M, N), or None.
        free: (N,) which inputs are no categories; d of them.
        factors: (d,) that those are scaled with.

    Raises:
        ValueError: both are given, shapes do not fit, or a value is not finite.
    """
    if derived is not None and gradients is not None:
        raise ValueError("give derived points or gradients, not both")
    shape = (len(inputs), outputs.shape[1], inputs.shape[1])
    if gradients is not None:
        slopes = np.array(gradients, dtype=np.float64)
        if slopes.shape != shape:
            raise ValueError(f"gradients must have shape {shape}, not {slopes.shape}")
        check_finite(slopes, "gradients")
        return np.asarray(slopes[:, :, free] / factors)
    if derived is None:
        return None
    around, said = (np.array(each, dtype=np.float64) for each in derived)
    if around.ndim != 3 or around.shape[1] == 0 or around.shape[::2] != shape[::2]:
        raise ValueError(f"derived inputs must have shape ({shape[0]}, K, {shape[2]}), not {around.shape}")
    if said.shape != (*around.shape[:2], shape[1]):
        raise ValueError(f"derived outputs must have shape {(*around.shape[:2], shape[1])}, not {said.shape}")
    check_finite(around, "derived inputs")
    check_finite(said, "derived outputs")
    points, around = inputs[:, free] * factors, around[:, :, free] * factors
    return np.array([approximate.leaf_map(*each) for each in zip(points, outputs, around, said, strict=True)])
