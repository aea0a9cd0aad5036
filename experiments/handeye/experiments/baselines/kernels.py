"""The learning rules, one call for one pass over the samples. Shapes: n samples, m neurons, d inputs, p outputs.

Arrays are contiguous float64 (order: int64); what learns is changed in place; nothing is validated.
"""

# numba infers the types.
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

import math

import numpy as np
from numba import njit

NEGLIGIBLE = 1e-3
"""Neurons whose share of a step is smaller stay as they are."""


@njit(cache=True, nogil=True)
def decayed(ends, progress):
    """A rate or width that falls exponentially from ends[0] to ends[1] while progress goes from 0 to 1."""
    return ends[0] * (ends[1] / ends[0]) ** progress


@njit(cache=True, nogil=True)
def squares_to(x, references, squares):
    """Fills squares (m,) with the squared distances of the reference vectors (m, d) from x (d,)."""
    for r in range(references.shape[0]):
        total = 0.0
        for i in range(x.shape[0]):
            difference = x[i] - references[r, i]
            total += difference * difference
        squares[r] = total


@njit(cache=True, nogil=True)
def adapt(r, x, y, references, outputs, slopes, step, blur):
    """Draws neuron r towards the input x and its local linear map towards the output y there.

    The map follows the Widrow-Hoff rule. It is normalised by |x - w|^2 + blur: without blur, samples that all but
    coincide with the reference vector would shake the slopes. As the reference moves, the output moves along the map.
    """
    square = blur
    for i in range(x.shape[0]):
        square += (x[i] - references[r, i]) ** 2
    for q in range(y.shape[0]):
        error = y[q] - outputs[r, q]
        for i in range(x.shape[0]):
            error -= slopes[r, q, i] * (x[i] - references[r, i])
        outputs[r, q] += step * error
        for i in range(x.shape[0]):
            offset = x[i] - references[r, i]
            if square > 0.0:
                slopes[r, q, i] += step * error * offset / square
            outputs[r, q] += slopes[r, q, i] * step * offset
    for i in range(x.shape[0]):
        references[r, i] += step * (x[i] - references[r, i])


@njit(cache=True, nogil=True)
def kohonen_pass(inputs, values, order, span, hops, widths, rates, blur, references, outputs, slopes):
    """Presents the samples once to a Kohonen map; the neighbourhood is a Gaussian of the distance on the lattice.

    span is the progress at the pass's beginning and end; hops (m, m) are squared distances on the lattice; widths and
    rates are what `decayed` takes. Returns the mean squared distance of the samples from their nearest references.
    """
    squares = np.empty(references.shape[0])
    total = 0.0
    for t in range(order.shape[0]):
        progress = span[0] + (span[1] - span[0]) * t / order.shape[0]
        width, rate = decayed(widths, progress), decayed(rates, progress)
        x, y = inputs[order[t]], values[order[t]]
        squares_to(x, references, squares)
        winner = np.argmin(squares)
        total += squares[winner]
        for r in range(references.shape[0]):
            share = math.exp(-hops[winner, r] / (2.0 * width * width))
            if share > NEGLIGIBLE:
                adapt(r, x, y, references, outputs, slopes, rate * share, blur)
    return total / order.shape[0]


@njit(cache=True, nogil=True)
def gas_pass(inputs, values, order, span, widths, rates, blur, references, outputs, slopes):
    """As `kohonen_pass` for neural gas: the neighbourhood falls exponentially with the rank by distance."""
    squares = np.empty(references.shape[0])
    total = 0.0
    for t in range(order.shape[0]):
        progress = span[0] + (span[1] - span[0]) * t / order.shape[0]
        width, rate = decayed(widths, progress), decayed(rates, progress)
        x, y = inputs[order[t]], values[order[t]]
        squares_to(x, references, squares)
        ranked = np.argsort(squares)
        total += squares[ranked[0]]
        for rank in range(references.shape[0]):
            share = math.exp(-rank / width)
            if share <= NEGLIGIBLE:
                break
            adapt(ranked[rank], x, y, references, outputs, slopes, rate * share, blur)
    return total / order.shape[0]


@njit(cache=True, nogil=True)
def answer_by_maps(inputs, references, outputs, slopes, answers):
    """Fills answers (q, p): eq 2.1, the local linear map of the neuron nearest to each of the inputs (q, d)."""
    squares = np.empty(references.shape[0])
    for t in range(inputs.shape[0]):
        squares_to(inputs[t], references, squares)
        s = np.argmin(squares)
        for q in range(answers.shape[1]):
            answer = outputs[s, q]
            for i in range(inputs.shape[1]):
                answer += slopes[s, q, i] * (inputs[t, i] - references[s, i])
            answers[t, q] = answer


@njit(cache=True, nogil=True)
def backprop_pass(inputs, values, order, rate, momentum, hidden, output, hidden_step, output_step):
    """One cycle of back-propagation, sample by sample, through logistic hidden units to linear outputs.

    hidden (m, d + 1) and output (p, m + 1) are the weights, biases last. The steps, shaped like them, are the weights'
    last changes, of which momentum is kept.
    """
    m, d, p = hidden.shape[0], inputs.shape[1], values.shape[1]
    states, blames = np.empty(m), np.empty(m)
    for t in range(order.shape[0]):
        x, y = inputs[order[t]], values[order[t]]
        for j in range(m):
            total = hidden[j, d]
            for i in range(d):
                total += hidden[j, i] * x[i]
            states[j] = 1.0 / (1.0 + math.exp(min(-total, 700.0)))  # exp() overflows beyond 709
            blames[j] = 0.0
        for q in range(p):
            error = y[q] - output[q, m]
            for j in range(m):
                error -= output[q, j] * states[j]
            for j in range(m):
                blames[j] += error * output[q, j]
                output_step[q, j] = rate * error * states[j] + momentum * output_step[q, j]
                output[q, j] += output_step[q, j]
            output_step[q, m] = rate * error + momentum * output_step[q, m]
            output[q, m] += output_step[q, m]
        for j in range(m):
            blame = blames[j] * states[j] * (1.0 - states[j])
            for i in range(d):
                hidden_step[j, i] = rate * blame * x[i] + momentum * hidden_step[j, i]
                hidden[j, i] += hidden_step[j, i]
            hidden_step[j, d] = rate * blame + momentum * hidden_step[j, d]
            hidden[j, d] += hidden_step[j, d]
