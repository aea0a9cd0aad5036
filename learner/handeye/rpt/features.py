"""Most discriminating features: principal components, then discriminant analysis (thesis 4.2.7; Swets and Weng 1996).

Samples are first written in their principal components (the *most expressive* features), each divided by its standard
deviation. There the total scatter is the unit matrix, and discriminant analysis, whose ratio of between-class to
within-class scatter is largest where that of between-class to total scatter is, becomes a singular value decomposition.
A ridge keeps components that hardly vary from being blown up.

Three kinds of features follow, each kept only while it says more than it would if the outputs were dealt out at random:

1. directions along which the classes' means differ; for regression, those that foretell the outputs linearly;
2. for regression, directions along which means of clusters of the outputs differ beyond that;
3. for regression, directions along which samples that 1 leaves unexplained differ from others in *spread* and not in
   mean: principal Hessian directions (K.-C. Li, JASA 87, 1992). An output that depends on (x - 1/2)^2 shows only there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_COMPONENTS = 256
EXPRESSED = 0.999
"""So many principal components at most are kept, fewer if they hold this share of the variance."""
RIDGES = (1e-3, 1e-2, 1e-1, 1.0)
"""Tried, as shares of the components' mean variance; the one that foretells left-out samples best is taken."""
CLUSTERS = 8
"""Classes made of the outputs for regression."""
MOST_OF_A_KIND = 4
"""Features of kinds 2 and 3 are at most so many each."""
SHUFFLES = 4
"""How often outputs are dealt out at random to see what features come from nothing."""
_NOTHING = 1e-10  # of a share of variance: rounding


class Features(NamedTuple):
    """What a node sees of a sample: m discriminating features, and how unlike the node's samples it is on the whole."""

    mean: Floats
    """(d,) of the node's samples."""
    directions: Floats
    """(d, m) along which the features are measured; each has variance 1 among the node's samples."""
    subspace: Floats
    """(d, q) the principal components, orthonormal."""
    scales: Floats
    """(q + 1,) their standard deviations with the ridge, descending; the last one serves outside the subspace."""

    def project(self, rows: Floats) -> Floats:
        """(n, m) features of rows (n, d), or (m,) of one row (d,)."""
        return np.asarray((rows - self.mean) @ self.directions)

    def unlikeness(self, row: Floats) -> float:
        """How far a row (d,) lies from the node's samples on the whole, in standard deviations.

        A Mahalanobis distance: along each principal component in units of its own deviation, and outside the principal
        subspace in units of the smallest.
        """
        offset = row - self.mean
        along = self.subspace.T @ offset
        outside = np.linalg.norm(offset - self.subspace @ along)
        return float(np.linalg.norm(np.append(along, outside) / self.scales))


def find_features(points: Floats, targets: Floats, groups: Integers, *, classes: bool) -> Features:
    """The features of one node.

    Args:
        points: (n, d) its samples, in comparable units.
        targets: (n, p) outputs in comparable units, or for each class a column of 1 and 0.
        groups: (n,) what belongs together and is left out together.
        classes: whether targets are classes.
    """
    n = len(points)
    mean = points.mean(axis=0)
    left, variances, subspace = _principal_components(points - mean)
    centred = targets - targets.mean(axis=0)
    if not len(variances):  # all samples coincide
        return Features(mean, np.zeros((len(mean), 0)), subspace, np.ones(1))
    share = variances.mean()
    trials = [left_out(left, variances / (variances + ridge * share), centred, groups) for ridge in RIDGES]
    errors = [float((trial**2).mean()) for trial in trials]
    best = int(np.argmin(errors))
    scale = np.sqrt(variances + RIDGES[best] * share)
    whitened = left * np.sqrt(n * variances) / scale
    rng = np.random.default_rng(n)

    found = [_along_means(whitened, centred, rng, whitened.shape[1])]
    if not classes:
        clusters = np.eye(CLUSTERS)[cluster(targets, CLUSTERS)]
        beyond = clusters - clusters.mean(axis=0)
        basis = _orthonormal(centred)
        found.append(_along_means(whitened, beyond - basis @ (basis.T @ beyond), rng, MOST_OF_A_KIND))
        found.append(_along_spread(whitened, trials[best], rng))
    chosen = _orthonormal(np.hstack(found))
    if not chosen.shape[1]:
        # Nothing discriminates, as where all outputs are equal: the most expressive features serve.
        chosen = np.eye(len(variances))[:, :MOST_OF_A_KIND]
    directions = subspace @ (chosen / scale[:, np.newaxis])
    spread = np.sqrt(((whitened @ chosen) ** 2).mean(axis=0))
    directions = np.ascontiguousarray(_signed(directions / np.maximum(spread, 1e-300)))
    return Features(mean, directions, np.ascontiguousarray(subspace), np.append(scale, scale[-1]))


def left_out(left: Floats, kept: Floats, centred: Floats, groups: Integers) -> Floats:
    """(n, p) what a linear map says wrongly of each group of samples if it is fitted without them.

    In closed form: with the hat matrix H = 1/n + U diag(kept) U', the residuals r of a group g become
    (I - H_gg)^-1 r_g.

    Args:
        left: (n, q) U, the samples' left singular vectors.
        kept: (q,) how much of each component the ridge leaves, 0 to 1.
        centred: (n, p) targets less their mean.
        groups: (n,); where there is but one, each sample counts as its own.
    """
    n = len(left)
    residuals = centred - (left * kept) @ (left.T @ centred)
    if (groups == groups[0]).all():
        groups = np.arange(n)  # a single group cannot be left out; its samples can
    order = np.argsort(groups, kind="stable")
    for members in np.split(order, np.flatnonzero(np.diff(groups[order])) + 1):
        own = left[members]
        leverage = 1 / n + (own * kept) @ own.T
        gap = np.eye(len(members)) - leverage
        # A sample that alone determines a direction has no gap; its residual is 0 too and stays.
        residuals[members] = np.linalg.solve(gap + 1e-9 * np.eye(len(members)), residuals[members])
    return residuals


def cluster(outputs: Floats, count: int) -> Integers:
    """(n,) numbers of at most `count` clusters of the outputs (n, p).

    Begins with the output nearest to the mean and those farthest from all before (so that it needs no chance), and
    moves the centres by Lloyd's iterations.
    """
    distance = ((outputs - outputs.mean(axis=0)) ** 2).sum(axis=1)
    centres = outputs[[int(np.argmin(distance))]]
    nearest = ((outputs - centres[0]) ** 2).sum(axis=1)
    while len(centres) < count and nearest.max() > 0:
        centres = np.vstack([centres, outputs[int(np.argmax(nearest))]])
        nearest = np.minimum(nearest, ((outputs - centres[-1]) ** 2).sum(axis=1))
    labels = np.zeros(len(outputs), np.int64)
    for _ in range(25):
        before = labels
        labels = ((outputs[:, np.newaxis] - centres) ** 2).sum(axis=2).argmin(axis=1)
        if np.array_equal(before, labels):
            break
        for c in np.unique(labels):
            centres[c] = outputs[labels == c].mean(axis=0)
    return labels


def _principal_components(centred: Floats) -> tuple[Floats, Floats, Floats]:
    """Left singular vectors (n, q), variances (q,) descending, and principal components (d, q).

    From the n x n or the d x d matrix of products, whichever is smaller.
    """
    n, d = centred.shape
    wide = n < d
    values, vectors = np.linalg.eigh(centred @ centred.T if wide else centred.T @ centred)
    values, vectors = np.maximum(values[::-1], 0.0) / n, vectors[:, ::-1]
    held = np.cumsum(values)
    most = int(np.searchsorted(held, EXPRESSED * held[-1])) + 1 if wide else len(values)
    count = min(most, MOST_COMPONENTS, n - 1, int((values > _NOTHING * max(values[0], 1e-300)).sum()))
    values, vectors = values[:count], vectors[:, :count]
    lengths = np.sqrt(n * values)
    if wide:
        return vectors, values, centred.T @ vectors / lengths
    return centred @ vectors / lengths, values, vectors


def _along_means(whitened: Floats, targets: Floats, rng: np.random.Generator, most: int) -> Floats:
    """(q, m) directions along which the means of targets differ most, and more than those of shuffled targets."""
    basis = _orthonormal(targets)
    if not basis.shape[1]:
        return np.zeros((whitened.shape[1], 0))
    _, strengths, directions = np.linalg.svd(basis.T @ whitened, full_matrices=False)
    chance = max(np.linalg.norm(rng.permutation(basis).T @ whitened, 2) for _ in range(SHUFFLES))
    return np.asarray(directions[strengths > chance][:most].T)


def _along_spread(whitened: Floats, residuals: Floats, rng: np.random.Generator) -> Floats:
    """(q, m) directions whose squares go with the residuals (n, p), more than with shuffled ones."""
    size = residuals.std(axis=0)
    if not np.any(size > _NOTHING):
        return np.zeros((whitened.shape[1], 0))
    parts = residuals[:, size > _NOTHING]
    parts = (parts - parts.mean(axis=0)) / parts.std(axis=0)

    def hessians(weights: Floats) -> Floats:
        matrices = [(whitened * column[:, np.newaxis]).T @ whitened / len(whitened) for column in weights.T]
        return np.asarray(sum(matrix @ matrix for matrix in matrices))

    strengths, directions = np.linalg.eigh(hessians(parts))
    chance = max(float(np.linalg.eigvalsh(hessians(rng.permutation(parts)))[-1]) for _ in range(SHUFFLES))
    return np.asarray(directions[:, strengths > chance][:, ::-1][:, :MOST_OF_A_KIND])


def _orthonormal(columns: Floats) -> Floats:
    """An orthonormal basis of the columns, earlier ones first; what adds nothing is left out."""
    basis = np.zeros((len(columns), 0))
    for column in columns.T:
        rest = column - basis @ (basis.T @ column)
        rest = rest - basis @ (basis.T @ rest)
        length = float(np.linalg.norm(rest))
        if length > 1e-7 * max(float(np.linalg.norm(column)), 1e-300):
            basis = np.column_stack([basis, rest / length])
    return basis


def _signed(vectors: Floats) -> Floats:
    """The columns with their largest element positive: a decomposition leaves the sign open."""
    if not vectors.size:
        return vectors
    largest = vectors[np.abs(vectors).argmax(axis=0), np.arange(vectors.shape[1])]
    return np.asarray(vectors * np.where(largest < 0, -1.0, 1.0))
