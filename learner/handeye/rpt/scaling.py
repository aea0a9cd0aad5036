"""Scales: which differences of the input components count alike (candidates; `selection` chooses among them).

* *deviation*: each component's standard deviation.
* *sensitivity*: the inverse of how strongly the outputs respond to a component, so that inputs which mean nothing
  hardly count.
* *curvature*: the inverse square root of how strongly that response changes. A local function may reach far along
  components in which the map is nearly linear.

Response and its change are those of a quadratic function of standardised components, fitted to all samples: with all
products where there are three samples for each term, else with squares only, or none.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

SMALLEST = 1e-150
"""The inverse of a smaller scale could not be squared."""
CONSTANT = 1e-12
"""A component that varies less than this share of its magnitude is a constant with rounding errors."""
RIDGE = 1e-3
"""Of the quadratic function; as a share of the inputs' variance."""
LEAST_SHARE = 1e-2
"""A component counts at least so much of the one that counts most."""
SAMPLES_PER_TERM = 3
LARGEST = 500
"""Terms; larger functions are not fitted."""


def spread(values: Floats) -> Floats:
    """The standard deviations (c,) of the columns of values (n, c); 1 for a constant column."""
    magnitude = np.abs(values).max(axis=0)
    unit = np.maximum(magnitude, SMALLEST)
    deviation = (values / unit).std(axis=0)
    return np.where(deviation > CONSTANT, np.maximum(deviation * unit, SMALLEST), 1.0)


def candidate_scales(inputs: Floats, outputs: Floats, category: Integers) -> dict[str, Floats]:
    """Scales (d,) by name, for inputs (n, d), outputs (n, p) and the number of each sample's category (n,)."""
    scales = {"deviation": spread(inputs)}
    n, d = inputs.shape
    squares, products = 2 * d, d + d * (d + 1) // 2
    if d == 1 or n < SAMPLES_PER_TERM * (d + 1) or d > LARGEST:
        return scales
    pairs = np.zeros((0, 2), np.int64)
    for count, (first, second) in ((squares, (np.arange(d),) * 2), (products, np.triu_indices(d))):
        if n >= SAMPLES_PER_TERM * (1 + count) and count <= LARGEST:
            pairs = np.column_stack([first, second])
    slopes, curvatures = _responses(_centred(inputs, category), _centred(outputs, category), pairs)
    sensitivity = np.sqrt(np.sum(slopes**2, axis=1) + np.sum(curvatures**2, axis=(1, 2)))
    scales["sensitivity"] = scales["deviation"] / _shares(sensitivity)
    if len(pairs):
        scales["curvature"] = scales["deviation"] / _shares(np.sqrt(np.sqrt(np.sum(curvatures**2, axis=(1, 2)))))
    return scales


def _centred(values: Floats, category: Integers) -> Floats:
    """Values (n, c) with no mean in any category and deviations of 1 (0 for constants)."""
    scaled = values / spread(values)
    for number in range(category.max() + 1):
        mine = category == number
        scaled[mine] -= scaled[mine].mean(axis=0)
    return scaled


def _responses(inputs: Floats, outputs: Floats, pairs: Integers) -> tuple[Floats, Floats]:
    """Slopes (d, p) at the middle and second derivatives (d, d, p) of a fit with the products of these pairs (t, 2)."""
    n, d = inputs.shape
    design = np.column_stack([inputs, inputs[:, pairs[:, 0]] * inputs[:, pairs[:, 1]]])
    design -= design.mean(axis=0)
    moments = design.T @ design / n
    moments[np.diag_indices_from(moments)] += RIDGE
    coefficients = np.linalg.solve(moments, design.T @ outputs / n)
    curvatures = np.zeros((d, d, outputs.shape[1]))
    for (a, b), c in zip(pairs, coefficients[d:], strict=True):
        curvatures[a, b] += c
        curvatures[b, a] += c
    return coefficients[:d], curvatures


def _shares(strengths: Floats) -> Floats:
    """Strengths (d,) as shares of the largest, none of them tiny."""
    largest = strengths.max()
    return np.maximum(strengths / largest, LEAST_SHARE) if largest > 0 else np.ones(len(strengths))
