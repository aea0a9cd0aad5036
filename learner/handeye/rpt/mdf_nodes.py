"""How an MDF tree grows: nodes that find features of their own and partition their cells in them (thesis 4.2.7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handeye.rpt.approximate import local_linear, local_weights
from handeye.rpt.features import Features, find_features
from handeye.rpt.images import CELLS

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

FOLDS = 5
"""A node is judged by what it says to each fifth of its samples when its features are found without that fifth."""
SURE = 3.0
"""A child's own features are taken if they lower the errors by so many standard errors of that difference."""
SMALLEST = 1e-9
"""Distances below this, in standard deviations, are rounding."""
_STEPS = 12  # of the bisection that finds a radius


@dataclass(frozen=True, slots=True)
class MDFSettings:
    """How an MDF tree is built and asked."""

    neighbours: int = 40
    """Samples that an output is interpolated from; all when there are fewer."""
    voters: int = 10
    """Samples that vote for a class; all when there are fewer."""
    beam_width: int = 4
    """Nodes kept on each level of the descent."""
    fan_out: int = 8
    """Children of a node at most; at least 2."""
    smallest: int = 32
    """Fewest samples from which a node below the root finds features of its own."""
    cells: int = CELLS
    """An image is reduced to so many blocks along its longer side at most (`images`)."""
    smoothing: float = 0.3
    """Of the neighbours' weights (`approximate.local_weights`)."""
    ridge: float = 1e-2
    """On the slopes of the local fit (`approximate.local_linear`)."""

    def __post_init__(self) -> None:
        """Checks the values.

        Raises:
            ValueError: one is out of range.
        """
        for name, least in (
            ("neighbours", 1),
            ("voters", 1),
            ("beam_width", 1),
            ("fan_out", 2),
            ("smallest", 4),
            ("cells", 1),
        ):
            if getattr(self, name) < least:
                raise ValueError(f"{name} must be at least {least}, not {getattr(self, name)}")
        for name, low in (("smoothing", 1e-6), ("ridge", 1e-12)):
            if not low <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be finite and at least {low:g}, not {getattr(self, name)}")


class Samples(NamedTuple):
    """What nodes are grown from."""

    points: Floats
    """(n, d) in comparable units."""
    targets: Floats
    """(n, p) outputs in comparable units, or 1 in the column of the sample's class and 0 elsewhere (n, c)."""
    groups: Integers
    """(n,)"""
    classes: bool


class Judged(NamedTuple):
    """What a node finds of its samples when they are left out."""

    errors: Floats
    """(n,) squared, of its answers."""
    scores: Floats
    """(n, 2) distances to the nearest sample of another fold, in units of `spacing`, and unlikenesses."""


class MDFNode(NamedTuple):
    """One node: the cell of one sample among its siblings; the root stands for everything."""

    sample: int
    """Whose vector it holds; -1 for the root."""
    level: int
    features: Features | None
    """Its own; None for a leaf that uses its parent's."""
    places: Floats
    """(n, m) its samples in the space of its own or its parent's features."""
    members: Integers
    """(n,) its samples, ascending."""
    radius: float
    """Its children are farther apart; 0 where there are none."""
    children: tuple[int, ...]
    owner: int
    """The node whose features see its samples: itself or its parent."""


def grow(samples: Samples, settings: MDFSettings) -> tuple[list[MDFNode], Floats]:
    """The nodes, breadth first, and the samples' scores (n, 2) as `Judged` by the root."""
    everything = np.arange(len(samples.points))
    root = _find(samples, everything)
    nodes = [MDFNode(-1, 0, root, root.project(samples.points), everything, 0.0, (), 0)]
    judged = [_judge(samples, everything, settings)]
    scores = judged[0].scores
    for number, node in enumerate(nodes):  # grows meanwhile
        if node.features is None or len(node.members) < 2 * settings.smallest:
            continue
        radius, centres = cover(node.places, settings.fan_out)
        nearest = np.array([distances(node.places[centres], place).argmin() for place in node.places])
        children, theirs = [], []
        for child, centre in enumerate(centres):
            inside = nearest == child
            members, places, features = node.members[inside], node.places[inside], None
            own = judged[number]
            if len(members) >= settings.smallest:
                own = _judge(samples, members, settings)
                if _better(own.errors, judged[number].errors[inside]):
                    features = _find(samples, members)
                    places = features.project(samples.points[members])
            owner = number if features is None else len(nodes) + child
            level = node.level + 1
            children.append(MDFNode(int(node.members[centre]), level, features, places, members, 0.0, (), owner))
            theirs.append(own)
        if any(child.features is not None for child in children):
            first = len(nodes)
            nodes[number] = node._replace(radius=radius, children=tuple(range(first, first + len(children))))
            nodes += children
            judged += theirs
    return nodes, scores


def near(places: Floats, place: Floats, k: int) -> tuple[Integers, Floats]:
    """Which of the places (n, m) are the k nearest to one (m,), and their distances; ties by ascending number."""
    found = distances(places, place)
    order = np.argsort(found, kind="stable")[:k]
    return order, found[order]


def interpolate(place: Floats, places: Floats, values: Floats, weights: Floats, ridge: float, classes: bool) -> Floats:
    """The values (p,) at a place (m,): of a local linear fit in the features, or the classes' shares of the weights."""
    if classes or not len(place):
        return np.asarray(weights @ values)
    return local_linear(place, places, values, weights, ridge=ridge)


def distances(places: Floats, place: Floats) -> Floats:
    """(n,) from places (n, m) to one (m,)."""
    return np.asarray(np.sqrt(((places - place) ** 2).sum(axis=1)))


def spacing(places: Floats) -> float:
    """Median distance from a place (n, m) to the nearest other one: what is near, whatever the number of features.

    Distances in spaces of different features are compared in units of it. Found from up to 256 of the places.
    """
    chosen = np.unique(np.linspace(0, len(places) - 1, 256).astype(np.int64))
    second = min(1, len(places) - 1)
    found = [np.partition(distances(places, places[i]), second)[second] for i in chosen]
    return max(float(np.median(found)), SMALLEST)


def _find(samples: Samples, members: Integers) -> Features:
    points, targets, groups = samples.points[members], samples.targets[members], samples.groups[members]
    return find_features(points, targets, groups, classes=samples.classes)


def _judge(samples: Samples, members: Integers, settings: MDFSettings) -> Judged:
    """Answers each fold of the members' groups from the others, in features found without that fold."""
    _, groups = np.unique(samples.groups[members], return_inverse=True)
    if groups.max() == 0:
        groups = np.arange(len(members))
    errors, scores = np.zeros(len(members)), np.zeros((len(members), 2))
    for fold in range(min(FOLDS, groups.max() + 1) if len(members) > 1 else 0):
        left = groups % FOLDS == fold
        taught = members[~left]
        features = _find(samples, taught)
        places, targets = features.project(samples.points[taught]), samples.targets[taught]
        unit = spacing(places)
        for i in np.flatnonzero(left):
            point = samples.points[members[i]]
            place = features.project(point)
            order, found = near(places, place, settings.voters if samples.classes else settings.neighbours)
            weights = local_weights(found, smoothing=settings.smoothing)
            value = interpolate(place, places[order], targets[order], weights, settings.ridge, samples.classes)
            errors[i] = ((value - samples.targets[members[i]]) ** 2).sum()
            scores[i] = found[0] / unit, features.unlikeness(point)
    return Judged(errors, scores)


def _better(errors: Floats, than: Floats) -> bool:
    gain = than - errors
    return bool(gain.mean() > SURE * gain.std() / np.sqrt(len(gain)) and gain.mean() > 0)


def cover(places: Floats, most: int) -> tuple[float, Integers]:
    """The smallest radius, found by bisection, under which at most so many centres cover the places, and the centres.

    Centres are chosen as the tree chooses its nodes (Fig 3.18): in the order given, each place that is farther than the
    radius from all centres before becomes one.
    """
    high = 2 * float(distances(places, places[0]).max()) + 1e-12
    low, centres = high / 1024, np.zeros(1, np.int64)
    for _ in range(_STEPS):
        middle = float(np.sqrt(low * high))
        found = _centres(places, middle, most + 1)
        if len(found) <= most:
            high, centres = middle, found
        else:
            low = middle
    return high, centres


def _centres(places: Floats, radius: float, most: int) -> Integers:
    nearest = np.full(len(places), np.inf)
    found: list[int] = []
    while len(found) < most:
        far = nearest > radius
        if not far.any():
            break
        found.append(int(far.argmax()))
        nearest = np.minimum(nearest, distances(places, places[found[-1]]))
    return np.array(found, np.int64)
