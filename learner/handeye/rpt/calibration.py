"""What a model may be trusted with, found by asking it for samples that were left out.

Each of up to 512 samples is answered from the samples of the other groups (demonstrations) alone; without groups, or
with a single one, from all samples but itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handeye.rpt.kernels import answer as kernel
from handeye.rpt.kernels import layout
from handeye.rpt.kernels.calibrate import expect, leave_out, nearby_means
from handeye.rpt.tree import Tree, build

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

ASKED = 512
"""How many samples are left out and asked for, evenly spread over the order in which they came."""

COVERAGE = 0.9
"""How often an error should stay below the expected one."""

NEARBY = 8
"""Expected errors go by the residuals of so many of the nearest samples asked for."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The scores that support compares with, and the residuals that expected errors go by.

    Support is a conformal p-value (Vovk, Gammerman, Shafer: Algorithmic Learning in a Random World, 2005): the score of
    a query is its distance to the nearest sample, and support = (1 + number of calibrated scores that are at least as
    large) / (m + 1). If the query is exchangeable with the samples asked for, support <= e has a probability of at most
    e. It cannot fall below 1 / (m + 1).

    The expected error of an output is a locally scaled conformal quantile: q times the mean absolute residual of the
    eight nearest samples asked for, where q is chosen so that it would have covered nine of ten of them, each by its
    neighbours of other groups. It is infinite while there are too few samples to say.
    """

    scores: Floats
    """(m,) ascending: distances, in scaled inputs, from samples to the nearest sample of another group."""
    residuals: Floats
    """(m, p) absolute errors of the answers to the samples asked for."""
    quantile: Floats
    """(p,) q."""
    floor: Floats
    """(p,) added to local means, so that a few lucky residuals do not promise perfection."""
    anchors: Tree | None
    """The samples asked for; None when there are fewer than two samples."""

    @classmethod
    def unknown(cls, outputs: int) -> Calibration:
        """Before anything could be left out: half support at most, anywhere but on a sample; no expected error."""
        return cls(np.zeros(1), np.zeros((0, outputs)), np.zeros(outputs), np.zeros(outputs), None)

    def expected_errors(self, queries: Floats) -> Floats:
        """(q, p) for scaled queries (q, d)."""
        shape = (len(queries), self.residuals.shape[1])
        if self.anchors is None:
            return np.full(shape, np.inf)
        expected = np.empty(shape)
        arenas, nearby = self.anchors.arenas, min(NEARBY, self.anchors.samples)
        limit = arenas.integers[layout.SAMPLES]
        known = (self.residuals, self.floor, self.quantile)
        # A row of an answer has its query among other things.
        rows = np.ascontiguousarray(queries)
        expect(rows, arenas.integers, arenas.floats, limit, nearby, *known, expected)
        return expected


class LeftOut(NamedTuple):
    """Answers to m samples, each from the samples of other groups alone."""

    members: Integers
    """(m,) the samples' numbers in the tree."""
    labels: Integers
    """(m,) what was left out with each of them: its group, or itself."""
    answers: Floats
    """(m, row length) as in `kernels.answer`."""
    residuals: Floats
    """(m, p) absolute errors."""


def ask_left_out(
    tree: Tree, knowledge: Floats, rows: Integers, groups: Integers, rule: Floats, ask: int = ASKED
) -> LeftOut:
    """Leaves out and asks at most `ask` samples; knowledge, rows and rule as in `kernels.answer`, groups (n,)."""
    alive = np.flatnonzero(tree.alive)
    outputs, k = int(rule[kernel.OUTPUTS]), int(rule[kernel.NEIGHBOURS])
    labels = groups[alive]
    if len(np.unique(labels)) == 1:
        labels = np.arange(len(alive))
    order = np.argsort(labels, kind="stable")
    members, labels = alive[order], labels[order]
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(labels)) + 1, [len(members)]])
    asked = np.zeros(len(members), np.bool_)
    asked[np.argsort(members)[np.unique(np.linspace(0, len(members) - 1, min(len(members), ask)).astype(int))]] = True
    answers = np.zeros((len(members), kernel.row_length(outputs, tree.points.shape[1], k)))
    integers, floats = tree.arenas
    if len(rows):
        # Spare rows, for the gradients that do not know what was left out.
        knowledge = np.concatenate([knowledge, np.zeros((k, knowledge.shape[1]))])
    asked = leave_out(
        integers.copy(), floats, tree.slots, tree.storage, knowledge, rows.copy(), rule, members, bounds, asked, answers
    )
    answers, members, labels = answers[asked], members[asked], labels[asked]
    known = rows[members] if len(rows) else members
    return LeftOut(members, labels, answers, np.abs(answers[:, :outputs] - knowledge[known, :outputs]))


def calibrate(tree: Tree, knowledge: Floats, rows: Integers, groups: Integers, rule: Floats) -> Calibration:
    """What leaving out and asking says; arguments as of `ask_left_out`."""
    outputs, k = int(rule[kernel.OUTPUTS]), int(rule[kernel.NEIGHBOURS])
    if tree.samples < 2:
        return Calibration.unknown(outputs)
    members, labels, answers, residuals = ask_left_out(tree, knowledge, rows, groups, rule)
    if not len(members):
        return Calibration.unknown(outputs)
    nearest = outputs * (1 + tree.points.shape[1]) + kernel.EXTRAS + k
    floor = 0.1 * residuals.mean(axis=0)
    return Calibration(
        scores=np.sort(answers[:, nearest]),
        residuals=residuals,
        quantile=_quantile(residuals, floor, tree.points[members], labels),
        floor=floor,
        anchors=build(tree.points[members]),
    )


def _quantile(residuals: Floats, floor: Floats, points: Floats, labels: Integers) -> Floats:
    """(p,) the factor that covers COVERAGE of the residuals, with the conformal correction for their number."""
    m = len(residuals)
    rank = int(np.ceil((m + 1) * COVERAGE))
    if rank > m:
        return np.full(residuals.shape[1], np.inf)
    scale = nearby_means(points, labels, residuals, min(NEARBY, m - 1)) + floor
    ratios = np.divide(residuals, scale, out=np.zeros_like(residuals), where=scale > 0)
    return np.asarray(np.sort(ratios, axis=0)[rank - 1])
