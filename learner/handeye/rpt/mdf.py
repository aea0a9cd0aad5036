"""The MDF tree: a Recursive Partition Tree whose nodes see with features of their own (thesis 4.2.7).

For images, and for inputs most of which mean nothing. A node finds the features that discriminate best among the
samples of its cell (`features`) and partitions the cell in their space by the rules of the RPT: children are farther
apart than a radius, and the nearest one takes a sample. A child has features of its own if these answer left-out ones
of its cell better than its parent's features do; otherwise it is a leaf and its samples are compared by its parent's.

A query descends with a beam. Steps in different spaces are compared as shares of the radius of the node that made them,
and a path is as far as its farthest step. The features of the nearest leaf then choose the neighbours.
"""

from __future__ import annotations

import heapq
from dataclasses import asdict
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handeye.rpt.approximate import local_weights
from handeye.rpt.checks import as_points, as_rows, check_finite
from handeye.rpt.features import Features
from handeye.rpt.images import as_images, brighter_and_darker, reduce_images
from handeye.rpt.mdf_nodes import SMALLEST, MDFNode, MDFSettings, Samples, distances, grow, interpolate, near, spacing

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

__all__ = ["MDFAnswer", "MDFSettings", "MDFTree"]


class MDFAnswer(NamedTuple):
    """An answer to one query; to q queries each with a leading axis (q,). k neighbours, nearest first.

    Where a query met fewer than k samples the rest has ids of -1, infinite distances and no weight.
    """

    output: NDArray[Any]
    """(p,) in the outputs' units; () the class for a tree of classes."""
    ids: Integers
    """(k,) numbers of the samples, counted from 0 in the order given."""
    distances: Floats
    """(k,) in the answering node's feature space, in standard deviations of its samples."""
    weights: Floats
    """(k,) of the neighbours; they add up to 1."""
    support: Floats
    """() how much the query is like the taught samples, in (0, 1]: a conformal p-value."""


class _Met(NamedTuple):
    """What a query finds in the tree."""

    ids: Integers
    distances: Floats
    places: Floats
    place: Floats


class MDFTree:
    """A tree over inputs (n, d) or 8-bit images, with outputs (n, p) or classes; `fit` makes one.

    Deterministic: the same samples in the same order give the same tree and the same answers.
    """

    def __init__(self) -> None:
        """Use `fit` or `from_state`."""
        self.settings = MDFSettings()
        self.nodes: list[MDFNode] = []
        """Breadth first; number 0 is the root."""
        self.classes: NDArray[np.generic] | None = None
        """(c,) ascending; None for a tree of outputs."""
        self.outputs: Floats = np.empty((0, 0))
        """(n, p), or (n, c) of 0 and 1 for classes."""
        self.scores: Floats = np.empty((0, 2))
        """(m, 2) of left-out samples: distances to the nearest taught one, in units of `spacing`, and unlikenesses."""
        self._shape: tuple[int, ...] = ()  # of one input: (d,), or (rows, columns)
        self._centre: Floats = np.empty(0)
        self._scale: Floats = np.empty(0)
        self._spacing = 1.0
        self._usual: Floats = np.ones(2)
        """Median of each of the scores."""
        self._taught: Floats = np.empty(0)
        """(m,) the worse score of each left-out sample, in units of its median, ascending."""

    @classmethod
    def fit(
        cls,
        inputs: ArrayLike,
        outputs: ArrayLike | None = None,
        *,
        labels: ArrayLike | None = None,
        groups: ArrayLike | None = None,
        settings: MDFSettings | None = None,
    ) -> Self:
        """Builds a tree and calibrates its support.

        Args:
            inputs: (n, d) numbers, or (n, rows, columns) images as uint8.
            outputs: (n, p) or (n,); or give labels.
            labels: (n,) classes: whole numbers or strings.
            groups: (n,) whole numbers: samples that belong together, as those of one demonstration. They are left out
                together wherever samples are left out. Each sample is its own group when not given.
            settings: how to build and to answer.

        Raises:
            ValueError: inputs, outputs, labels or groups are empty, not finite, or of the wrong shape or kind.
        """
        tree = cls()
        tree.settings = settings or MDFSettings()
        array = np.asarray(inputs)
        if array.ndim == 3:
            images = as_images(array)
            tree._shape, rows = images.shape[1:], reduce_images(images, tree.settings.cells)
        else:
            rows = as_points(array)
            tree._shape = rows.shape[1:]
        if (outputs is None) == (labels is None):
            raise ValueError("give either outputs or labels")
        if labels is not None:
            tree.classes, tree.outputs = _as_classes(labels)
        elif outputs is not None:
            tree.outputs = _as_outputs(outputs)
        together = np.arange(len(rows)) if groups is None else np.asarray(groups)
        if not len(rows) == len(tree.outputs) == len(together) or together.dtype.kind not in "iu" or together.ndim != 1:
            raise ValueError(
                f"each input needs an output or a label and, if any, a whole number as its group; got {len(rows)} "
                f"inputs, {len(tree.outputs)} outputs and groups of shape {together.shape}, {together.dtype}"
            )
        tree._build(rows, together.astype(np.int64))
        return tree

    def answer(self, queries: ArrayLike) -> MDFAnswer:
        """Answers one query, (d,) or an image (rows, columns), or several with a leading axis.

        Raises:
            ValueError: queries are not of the shape or kind of the inputs, or not finite.
        """
        array = np.asarray(queries)
        if len(self._shape) == 2:
            images = as_images(array)
            if images.shape[1:] != self._shape:
                raise ValueError(
                    f"images must be of {self._shape[0]} x {self._shape[1]} pixels, not {images.shape[1:]}"
                )
            rows = reduce_images(images, self.settings.cells)
        else:
            rows = as_rows(array, self._shape[0], "queries")
        k = min(self._asked, len(self.outputs))
        ids, distances, weights = np.full((len(rows), k), -1), np.full((len(rows), k), np.inf), np.zeros((len(rows), k))
        values, support = np.empty((len(rows), self.outputs.shape[1])), np.empty(len(rows))
        for i, row in enumerate(rows):
            point = self._encode(row)
            met = self._search(point)
            count = len(met.ids)
            shares = local_weights(met.distances, smoothing=self.settings.smoothing)
            ids[i, :count], distances[i, :count], weights[i, :count] = met.ids, met.distances, shares
            near_values, known = self.outputs[met.ids], self.classes is not None
            values[i] = interpolate(met.place, met.places, near_values, shares, self.settings.ridge, known)
            support[i] = self._support(point)
        output = values if self.classes is None else self.classes[values.argmax(axis=1)]
        answer = MDFAnswer(output, ids, distances, weights, support)
        return answer if array.ndim > len(self._shape) else MDFAnswer(*(np.asarray(part[0]) for part in answer))

    def to_state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """All that `from_state` needs: plain values and arrays of numbers."""
        arrays: dict[str, NDArray[Any]] = {
            "shape": np.array(self._shape, np.int64),
            "centre": self._centre,
            "scale": self._scale,
            "outputs": self.outputs,
            "scores": self.scores,
            "nodes": np.array([(n.sample, n.level, n.features is not None, n.owner) for n in self.nodes], np.int64),
            "radii": np.array([node.radius for node in self.nodes]),
        }
        for i, node in enumerate(self.nodes):
            arrays |= {f"{i}.places": node.places, f"{i}.members": node.members}
            arrays[f"{i}.children"] = np.array(node.children, np.int64)
            if node.features is not None:
                arrays |= {f"{i}.{name}": part for name, part in node.features._asdict().items()}
        classes = None if self.classes is None else self.classes.tolist()
        return {"settings": asdict(self.settings), "classes": classes}, arrays

    @classmethod
    def from_state(cls, values: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Self:
        """The tree that `to_state` described; it gives the same answers to the last bit.

        Raises:
            ValueError: the parts do not fit together.
            KeyError: a part is missing.
        """
        tree = cls()
        tree.settings = MDFSettings(**values["settings"])
        tree._shape = tuple(arrays["shape"].tolist())
        tree._centre, tree._scale = arrays["centre"], arrays["scale"]
        tree.outputs, tree.scores = arrays["outputs"], arrays["scores"]
        tree.classes = None if values["classes"] is None else np.array(values["classes"])
        for i, (sample, level, own, owner) in enumerate(arrays["nodes"].tolist()):
            parts = [arrays[f"{i}.{name}"] for name in Features._fields] if own else None
            features = None if parts is None else Features(*parts)
            children, members = tuple(arrays[f"{i}.children"].tolist()), arrays[f"{i}.members"]
            radius, places = float(arrays["radii"][i]), arrays[f"{i}.places"]
            tree.nodes.append(MDFNode(sample, level, features, places, members, radius, children, owner))
        tree._check()
        tree._calibrate()
        return tree

    def _check(self) -> None:
        """Raises a ValueError unless every number of a sample or a node means one, and nodes stand breadth first."""
        for i, node in enumerate(self.nodes):
            owner = self.nodes[node.owner] if 0 <= node.owner <= i else None
            fits = owner is not None and owner.features is not None and len(node.places) == len(node.members) > 0
            fits &= bool(np.all((node.members >= 0) & (node.members < len(self.outputs))))
            fits &= all(i < child < len(self.nodes) for child in node.children)
            if not fits:
                raise ValueError(f"node {i} does not fit the rest of the tree")
        if not self.nodes:
            raise ValueError("there is no node")

    def _build(self, rows: Floats, groups: Integers) -> None:
        self._centre, self._scale = rows.mean(axis=0), _deviations(rows)
        if len(self._shape) == 2:
            # One scale for all blocks, so that those where nothing ever changes are not made important.
            self._scale = _deviations(rows.ravel() - np.tile(self._centre, len(rows)), keepdims=True)
        targets = self.outputs
        if self.classes is None:
            targets = (targets - targets.mean(axis=0)) / _deviations(targets)
        samples = Samples(self._encode(rows), targets, groups, self.classes is not None)
        self.nodes, self.scores = grow(samples, self.settings)
        if len(rows) == 1:
            self.scores = self.scores[:0]  # nothing to compare with
        self._calibrate()

    def _calibrate(self) -> None:
        """What every query is compared with."""
        self._spacing = spacing(self.nodes[0].places)
        if len(self.scores):
            self._usual = np.maximum(np.median(self.scores, axis=0), SMALLEST)
            self._taught = np.sort((self.scores / self._usual).max(axis=1))

    @property
    def _asked(self) -> int:
        """How many samples make an answer."""
        return self.settings.neighbours if self.classes is None else self.settings.voters

    # --- Asking ------------------------------------------------------------------------------------------------------

    def _encode(self, rows: Floats) -> Floats:
        """Vectors that features are computed of, from inputs or reduced images (n, b) or (b,)."""
        if len(self._shape) == 2:
            split = brighter_and_darker(np.atleast_2d(rows), self._centre) / self._scale
            return split if rows.ndim == 2 else np.asarray(split[0])
        return np.asarray((rows - self._centre) / self._scale)

    def _features(self, number: int) -> Features:
        """Of a node that has its own: the root, owners, and all with children."""
        features = self.nodes[number].features
        if features is None:
            raise LookupError(f"node {number} has no features of its own")
        return features

    def _search(self, point: Floats) -> _Met:
        """The nearest samples in the leaves that a beam reaches below the node whose features answer."""
        leaves = self._beam(point)
        owner = self.nodes[leaves[0]].owner
        below = {owner}
        for number, node in enumerate(self.nodes):  # breadth first: parents come before their children
            if number in below:
                below.update(node.children)
        members = np.sort(np.concatenate([self.nodes[leaf].members for leaf in leaves if leaf in below]))
        places = self.nodes[owner].places[np.searchsorted(self.nodes[owner].members, members)]
        place = self._features(owner).project(point)
        order, found = near(places, place, self._asked)
        return _Met(members[order], found, places[order], place)

    def _beam(self, point: Floats) -> list[int]:
        """The leaves that a beam reaches, nearest first."""
        level: list[tuple[float, float, int]] = [(0.0, 0.0, 0)]
        while any(self.nodes[number].children for _, _, number in level):
            met: list[tuple[float, float, int]] = []
            for farthest, step, number in level:
                node = self.nodes[number]
                if not node.children:
                    met.append((farthest, step, number))
                    continue
                held = node.places[np.searchsorted(node.members, [self.nodes[child].sample for child in node.children])]
                steps = distances(held, self._features(number).project(point)) / node.radius
                met += [
                    (max(farthest, float(share)), float(share), child)
                    for child, share in zip(node.children, steps, strict=True)
                ]
            level = heapq.nsmallest(self.settings.beam_width, met)
        return [number for _, _, number in level]

    def _support(self, point: Floats) -> float:
        """A conformal p-value; the score is the worse of distance and unlikeness, each in units of its median.

        Both are the root's, so that all samples take part.
        """
        if not len(self.scores):
            return 1.0
        root = self._features(0)
        nearest = distances(self.nodes[0].places, root.project(point)).min() / self._spacing
        score = max(nearest / self._usual[0], root.unlikeness(point) / self._usual[1])
        count = len(self._taught)
        return float((1 + count - np.searchsorted(self._taught, score)) / (count + 1))


def _deviations(values: Floats, *, keepdims: bool = False) -> Floats:
    """Standard deviations of the columns; 1 where nothing but rounding differs."""
    found = values.std(axis=0, keepdims=keepdims)
    return np.asarray(np.where(found > 1e-12 * np.abs(values).max(axis=0, keepdims=keepdims), found, 1.0))


def _as_outputs(outputs: ArrayLike) -> Floats:
    """Outputs as an (n, p) array; (n,) becomes one column."""
    values = np.array(outputs, dtype=np.float64, order="C")
    if values.ndim == 1:
        values = values[:, np.newaxis]
    if values.ndim != 2 or values.size == 0:
        raise ValueError(f"outputs must be a non-empty (samples, components) array, not one of shape {values.shape}")
    check_finite(values, "outputs")
    return values


def _as_classes(labels: ArrayLike) -> tuple[NDArray[np.generic], Floats]:
    """The classes (c,), and for each sample 1 in its class's column (n, c)."""
    array = np.asarray(labels)
    if array.ndim != 1 or array.size == 0 or array.dtype.kind not in "iubU":
        raise ValueError(
            f"labels must be a non-empty row of whole numbers or strings, not of shape {array.shape}, {array.dtype}"
        )
    classes, numbers = np.unique(array, return_inverse=True)
    return classes, np.eye(len(classes))[numbers]
