"""Local polynomial fits: weighted, ridge-regularised least squares around a query."""

import math

import numpy as np
from numba import njit

SQRT2 = math.sqrt(2.0)


@njit(cache=True, nogil=True)
def solve_in_place(matrix, right, leading=-1):
    """Solves matrix @ x = right by elimination; matrix (n, n) is symmetric and positive definite; x replaces right.

    Only the upper triangle of the matrix is read, and it is overwritten. Returns the smallest of the first `leading`
    pivots, or of all: what is left of a diagonal element once the others before it are accounted for.
    """
    n = matrix.shape[0]
    columns = right.shape[1]
    smallest = np.inf
    for j in range(n):
        pivot = matrix[j, j]
        if leading < 0 or j < leading:
            smallest = min(smallest, pivot)
        for i in range(j + 1, n):
            factor = matrix[j, i] / pivot
            for s in range(i, n):
                matrix[i, s] -= factor * matrix[j, s]
            for s in range(columns):
                right[i, s] -= factor * right[j, s]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            for s in range(columns):
                right[i, s] -= matrix[i, j] * right[j, s]
        for s in range(columns):
            right[i, s] /= matrix[i, i]
    return smallest


@njit(cache=True, nogil=True)
def terms(point, middle, factor, degree, out):
    """Fills out with the terms of a polynomial in (point - middle) * factor, vectors (d,).

    They are its components; for degree 2 also all their products. Mixed products carry a factor sqrt(2): then a ridge
    on the products does not depend on how the inputs are rotated.
    """
    d = point.shape[0]
    for a in range(d):
        out[a] = (point[a] - middle[a]) * factor
    if degree == 2:
        place = d
        for a in range(d):
            out[place] = out[a] * out[a]
            for b in range(a + 1, d):
                out[place + b - a] = out[a] * out[b] * SQRT2
            place += d - a


@njit(cache=True, nogil=True)
def add_curvature(offset, coefficients, slope):
    """Adds to slope (p, d) the derivative of the second-order terms at an offset, the first d numbers of `offset`."""
    d = slope.shape[1]
    place = d
    for a in range(d):
        for b in range(a, d):
            for output in range(slope.shape[0]):
                c = coefficients[place, output]
                if a == b:
                    slope[output, a] += 2.0 * c * offset[a]
                else:
                    slope[output, a] += SQRT2 * c * offset[b]
                    slope[output, b] += SQRT2 * c * offset[a]
            place += 1


@njit(cache=True, nogil=True)
def local_fit(query, inputs, outputs, weights, degree, ridge, curvature_ridge, value, slope):
    """Fits a polynomial of degree 1 or 2 to k neighbours by weighted, ridge-regularised least squares.

    inputs (k, d); outputs (k, p); weights (k,) not negative and not all zero. Inputs are counted from their weighted
    mean in units of their spread, so the ridges (> 0) are shares of the inputs' variance. The constant term is free.
    Fills value (p,), the polynomial at the query, and slope (p, d), its gradient there. Returns whether the neighbours
    determine all first-order terms by themselves; where they don't, the ridge keeps those small.
    """
    k, d = inputs.shape
    p = outputs.shape[1]
    count = d if degree == 1 else d + d * (d + 1) // 2
    total = 0.0
    for i in range(k):
        total += weights[i]
    # Of the terms; those of first order are counted from their mean already.
    mean = np.zeros(count)
    middle = np.zeros(d)
    value[:] = 0.0
    for i in range(k):
        share = weights[i] / total
        for a in range(d):
            middle[a] += share * inputs[i, a]
        for b in range(p):
            value[b] += share * outputs[i, b]
    slope[:] = 0.0
    variance = 0.0
    for i in range(k):
        square = 0.0
        for a in range(d):
            square += (inputs[i, a] - middle[a]) ** 2
        variance += weights[i] / total * square / d
    if variance == 0.0:
        # All neighbours lie on one point and say nothing about slopes.
        return False
    spread = math.sqrt(variance)
    # A row for each neighbour: its terms, then its outputs, all counted from their means.
    design = np.empty((k, count + p))
    for i in range(k):
        terms(inputs[i], middle, 1.0 / spread, degree, design[i])
        share = weights[i] / total
        for a in range(d, count):
            mean[a] += share * design[i, a]
        for b in range(p):
            design[i, count + b] = outputs[i, b] - value[b]
    products = np.zeros((count, count + p))
    for i in range(k):
        share = weights[i] / total
        for a in range(d, count):
            design[i, a] -= mean[a]
        for a in range(count):
            off = share * design[i, a]
            for b in range(a, count + p):
                products[a, b] += off * design[i, b]
    moments, coefficients = products[:, :count], products[:, count:]
    for a in range(count):
        moments[a, a] += ridge if a < d else curvature_ridge
    # A direction in which the neighbours do not vary leaves nothing but the ridge.
    determined = solve_in_place(moments, coefficients, d) > 2.0 * ridge
    here = np.empty(count)
    terms(query, middle, 1.0 / spread, degree, here)
    for a in range(count):
        for b in range(p):
            value[b] += (here[a] - mean[a]) * coefficients[a, b]
    for b in range(p):
        for a in range(d):
            slope[b, a] = coefficients[a, b]
    if degree == 2:
        add_curvature(here, coefficients, slope)
    for b in range(p):
        for a in range(d):
            slope[b, a] /= spread
    return determined


@njit(cache=True, nogil=True)
def leaf_map(sample, output, inputs, outputs, ridge, slope):
    """Fills slope (p, d) with the map T of a leaf: U_D - U_P = T (V_D - V_P) by least squares (eqs 4.1 to 4.4).

    sample (d,) and output (p,) are the leaf's; inputs (K, d) and outputs (K, p) its derived points. The ridge is a
    share of the mean square of the offsets. Returns whether the derived points determine the map.
    """
    k, d = inputs.shape
    p = output.shape[0]
    slope[:] = 0.0
    square = 0.0
    for i in range(k):
        for a in range(d):
            square += (inputs[i, a] - sample[a]) ** 2
    if square == 0.0:
        return False
    unit = math.sqrt(square / (k * d))
    moments = np.zeros((d, d))
    right = np.zeros((d, p))
    for i in range(k):
        for a in range(d):
            off = (inputs[i, a] - sample[a]) / unit / k
            for b in range(a, d):
                moments[a, b] += off * (inputs[i, b] - sample[b]) / unit
            for b in range(p):
                right[a, b] += off * (outputs[i, b] - output[b])
    for a in range(d):
        moments[a, a] += ridge
    determined = solve_in_place(moments, right) > 2.0 * ridge
    for b in range(p):
        for a in range(d):
            slope[b, a] = right[a, b] / unit
    return determined
