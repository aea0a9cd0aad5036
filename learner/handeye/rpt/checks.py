"""What inputs must look like, and the sentences that say so."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handeye.rpt.kernels.answer import LARGEST

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def as_numbers(values: ArrayLike) -> Floats:
    """A copy of values in double precision.

    Raises:
        ValueError: they are no real numbers (TypeError for objects that know no number), or rows differ in length.
    """
    array = np.asarray(values)
    if array.dtype.kind in "cmMV":
        raise ValueError(f"expected real numbers, not an array of {array.dtype}")
    try:
        return np.array(array, dtype=np.float64, order="C")
    except OverflowError as error:
        raise ValueError(f"numbers must fit into double precision: {error}") from None


def as_points(inputs: ArrayLike, *, empty: bool = False) -> Floats:
    """A copy of inputs as an (n, d) array; a (n,) array is taken as n samples with one component.

    Raises:
        ValueError: inputs are empty (unless `empty`), not finite, too large, or of the wrong shape.
    """
    points = as_numbers(inputs)
    if points.ndim == 1:
        points = points[:, np.newaxis]
    if points.ndim != 2 or points.shape[1] == 0 or (len(points) == 0 and not empty):
        raise ValueError(f"inputs must be a non-empty (samples, components) array, not one of shape {points.shape}")
    check_finite(points, "inputs")
    return points


def as_rows(values: ArrayLike, components: int, name: str) -> Floats:
    """Values as an (n, components) array; one vector (components,) becomes one row.

    Raises:
        ValueError: values are not finite, too large, or of the wrong shape.
    """
    rows = as_numbers(values)
    if rows.ndim not in (1, 2) or rows.shape[-1] != components:
        raise ValueError(f"{name}: expected vectors of {components} components, not an array of shape {rows.shape}")
    check_finite(rows, name)
    return np.atleast_2d(rows)


def as_radii(radii: ArrayLike) -> Floats:
    """Radii as an array.

    Raises:
        ValueError: they are not a decreasing sequence of numbers >= 0.
    """
    chosen = as_numbers(radii)
    if chosen.ndim != 1 or chosen.size == 0 or not (chosen[-1] >= 0 and np.all(chosen[1:] < chosen[:-1])):
        raise ValueError(f"radii must be a decreasing sequence T(1) > ... > T(L) >= 0, not {chosen}")
    return chosen


def as_groups(groups: ArrayLike, n: int) -> Integers:
    """Groups as an (n,) array.

    Raises:
        ValueError: they are not n whole numbers >= 0.
    """
    labels = np.asarray(groups)
    if labels.shape != (n,) or labels.dtype.kind not in "iu" or (labels < 0).any():
        raise ValueError(f"groups must be {n} whole numbers >= 0; got {labels.dtype} of shape {labels.shape}")
    return labels.astype(np.int64)


def check_finite(values: Floats, name: str) -> None:
    """Raises a ValueError that names the first value which is not finite or too large to be squared."""
    # Extremes first: that takes no memory, and not a number is neither small nor large.
    if values.size and not (values.min() >= -LARGEST and values.max() <= LARGEST):
        fine = np.abs(values) <= LARGEST
        place = np.unravel_index(int(np.argmin(fine)), fine.shape)
        where = ", ".join(str(int(i)) for i in place)
        raise ValueError(
            f"{name} must be finite numbers of magnitude up to {LARGEST:g}; number [{where}] is {values[place]}"
        )
