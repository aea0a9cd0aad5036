"""Draws the pictures of theory.md: `python -m docs.learner.make_pictures` at the root of the repository.

The examples are those of the tests, in trees built by the literal reference that the library is tested against.
"""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from numpy.typing import NDArray

from docs.learner import drawing
from docs.learner.drawing import LEVELS, PALE, QUERY, QUIET, Window
from handeye import rpt
from handeye.rpt import approximate
from tests.learner import examples
from tests.learner.reference import Node, Tree, build, leaf_map, map_query, steps

Floats = NDArray[np.float64]

NAMES = list(examples.WALKTHROUGH)
PLACES = {
    "A": (-5.0, 3.0),
    "C": (0.0, -6.0),
    "d": (-4.0, -4.0),
    "α": (7.0, 0.0),
    "β": (0.0, 6.0),
    "χ": (-7.0, 0.0),
    "δ": (0.0, -7.0),
    "ε": (0.0, 6.0),
    "φ": (4.0, 3.0),
}

WHOLE: Window = (-10, 28, -10, 26)
NEAR_D: Window = (0.2, 9.8, -0.4, 9.2)
NEAR_E: Window = (18.5, 29.5, 1, 12)


def main() -> None:
    """Draws all."""
    for draw in (partition, construction, retrieval, miss, exact_search, adoption, methods, changelings, support):
        draw()


def partition() -> None:
    """The finished tree of Fig 3.35 and its partitions, as in Figs 3.8 to 3.11."""
    tree = build(list(examples.WALKTHROUGH.values()), examples.WALKTHROUGH_RADII)
    figure, axes = plt.subplot_mosaic("123;ttt", figsize=(8, 5.2), height_ratios=[3, 2.4])
    for level in (1, 2, 3):
        drawing.plane(axes[str(level)], WHOLE, f"level {level}")
        drawing.borders(axes[str(level)], tree, level)
        shown = build(tree.points, tree.radii[:level])
        drawing.points(axes[str(level)], shown, NAMES, places=PLACES)
    drawing.diagram(axes["t"], tree, NAMES, "the tree: a node that splits is its own first child")
    drawing.save(figure, "partition")


TITLES = {
    "Fig 3.22": "a, b covered; C added",
    "Fig 3.23": "a added on level 2",
    "Fig 3.28": "α, β, χ, δ covered; f added",
    "Fig 3.29": "ε covered; g added",
    "Fig 3.30": "α added on level 3",
}
LAYOUTS = {1: ("abc;dtt", 5.5), 2: ("abc;def;gtt", 8.2), 3: ("abc;def;ttt", 7.6)}


def construction() -> None:
    """Figs 3.19 to 3.35, one picture for each level."""
    pictures = {level: plt.subplot_mosaic(layout, figsize=(8, high)) for level, (layout, high) in LAYOUTS.items()}
    panels = {level: iter("abcdefg") for level in LAYOUTS}
    captions = {(level, name): caption for caption, level, name in examples.ADDED}
    empty = build([], examples.WALKTHROUGH_RADII)
    empty.points = list(examples.WALKTHROUGH.values())
    step(pictures[1][1][next(panels[1])], empty, 1, -1, "Fig 3.19  the samples")
    for tree, level, sample, added in steps(list(examples.WALKTHROUGH.values()), examples.WALKTHROUGH_RADII):
        figure, axes = pictures[level]
        if added:
            caption = captions[level, NAMES[sample]]
            title = TITLES.get(caption, f"{NAMES[sample]} added")
            step(axes[next(panels[level])], tree, level, sample, f"{caption}  {title}")
        if sample == len(NAMES) - 1:
            if level == 3:
                step(axes[next(panels[level])], tree, level, -1, "Fig 3.35  φ is covered by d")
            drawing.diagram(axes["t"], tree, NAMES, f"the tree when level {level} is complete")
            drawing.save(figure, f"construction-{level}")


def step(axes: Axes, tree: Tree, level: int, new: int, title: str) -> None:
    """One of Figs 3.19 to 3.35."""
    window = WHOLE if level < 3 else NEAR_E if NAMES[new] == "ε" else NEAR_D
    drawing.plane(axes, window, title)
    drawing.circles(axes, tree, level)
    drawing.borders(axes, tree, level)
    drawing.points(axes, tree, NAMES, places=PLACES, new=new)


def retrieval() -> None:
    """Figs 3.14 to 3.17: from A to d to δ."""
    tree = build(list(examples.WALKTHROUGH.values()), examples.WALKTHROUGH_RADII)
    query = examples.WALKTHROUGH_QUERY
    figure, axes = plt.subplots(1, 3, figsize=(8, 3))
    passed = tree.path(query)
    for level, panel in enumerate(axes.tolist(), start=1):
        window = [WHOLE, (-8, 12, -8, 12), NEAR_D][level - 1]
        drawing.plane(panel, window, f"level {level}: {NAMES[passed[level].sample]}")
        drawing.borders(panel, tree, level)
        drawing.points(panel, tree, NAMES, places=PLACES)
        ends = [tree.points[child.sample] for child in passed[level - 1].children]
        drawing.rays(panel, query, ends, [tree.points[passed[level].sample]])
        drawing.query_at(panel, query)
    drawing.save(figure, "retrieval")


def miss() -> None:
    """Fig 3.36."""
    tree, names = build(list(examples.MISS.values()), examples.MISS_RADII), list(examples.MISS)
    figure, axes = plt.subplots(1, 2, figsize=(8, 2.9))
    for width, panel in zip((1, 2), axes.tolist(), strict=True):
        found = tree.beam(examples.MISS_QUERY, 1, width)[0][0]
        drawing.plane(panel, (-3, 23, -7.5, 8.5), f"a beam of width {width} finds {names[found]}")
        drawing.borders(panel, tree, 2)
        drawing.points(panel, tree, names, places={"e": (-5, 4)})
        compared = [vector for name, vector in examples.MISS.items() if width == 2 or name != "e"]
        drawing.rays(panel, examples.MISS_QUERY, compared, [tree.points[found]])
        drawing.query_at(panel, examples.MISS_QUERY, place=(4, 6))
    drawing.save(figure, "miss")


def adoption() -> None:
    """Fig B.1, and repair."""
    names, vectors = list(examples.ADOPTION), list(examples.ADOPTION.values())
    tree = Tree(examples.ADOPTION_RADII)
    figure, axes = plt.subplot_mosaic("abc;xyz", figsize=(8, 4.0), height_ratios=[3, 2.4])

    def show(panels: str, title: str) -> None:
        lost = tree.invisible()
        drawing.plane(axes[panels[0]], (-8, 17, -7, 10), title)
        drawing.borders(axes[panels[0]], tree, 3)
        drawing.points(axes[panels[0]], tree, names, places={"c": (0, -5)}, quiet=[node.sample for node in lost])
        drawing.diagram(axes[panels[1]], tree, names, "", lost=lost)

    for vector in vectors[:-1]:
        tree.insert(vector)
    show("ax", "before C")
    tree.insert(vectors[-1])
    show("by", "C hides three nodes (dashed)")
    tree.repair()
    show("cz", "repaired")
    drawing.save(figure, "adoption")


def exact_search() -> None:
    """Branch and bound on the boxes around the nodes' samples."""
    rng = np.random.default_rng(3)
    vectors = rng.uniform((0, 0), (24, 9), (40, 2)).repeat(4, axis=0) + rng.normal(scale=0.5, size=(160, 2))
    tree, query, k = build(vectors, (4.5, 1.2)), np.array([11.9, 3.6]), 5
    samples = {node: vectors[tree.filed(node)] for node in tree.nodes()}
    found: list[float] = []
    opened: list[Node] = []

    def reach(node: Node) -> float:
        low, high = samples[node].min(axis=0), samples[node].max(axis=0)
        return float(np.linalg.norm(np.maximum(np.maximum(low - query, query - high), 0)))

    def search(node: Node) -> None:
        for child in sorted(node.children, key=reach):
            if len(found) < k or reach(child) <= found[k - 1]:
                opened.append(child)
                search(child)
        if not node.children:
            found.extend(np.linalg.norm(samples[node] - query, axis=1).tolist())
            found.sort()

    search(tree.root)
    figure, axes = plt.subplots(figsize=(8, 3.7))
    drawing.plane(axes, (-0.8, 24.6, -1.2, 10.4), f"the {k} nearest of {len(vectors)} samples: {len(found)} looked at")
    for node in sorted(samples, key=lambda node: node in opened):
        drawing.box(axes, samples[node], LEVELS[node.level] if node in opened else PALE, width=2.2 - 0.6 * node.level)
    axes.plot(*vectors.T, "o", ms=2.5, color=QUIET, zorder=3)
    looked = np.concatenate([samples[node] for node in opened if not node.children])
    axes.plot(*looked.T, "o", ms=3, color="black", zorder=4)
    axes.add_patch(Circle((query[0], query[1]), found[k - 1], fc=QUERY, ec=QUERY, alpha=0.25, zorder=3))
    drawing.query_at(axes, query.tolist())
    drawing.save(figure, "exact")


def methods() -> None:
    """3.3 and 4.1.2 in one dimension."""

    def truth(x: Floats) -> Floats:
        return np.asarray(np.sin(x) + x / 4)

    inputs = np.array([0.3, 1.1, 1.6, 2.6, 3.3, 4.4, 4.9, 6.1, 6.8, 7.9])
    outputs, places = truth(inputs)[:, np.newaxis], np.linspace(0, 8.2, 400)
    tree, literal = rpt.build(inputs), build(inputs[:, np.newaxis], (1.0, 0.5))
    gradients = approximate.estimate_gradients(tree, outputs, neighbours=4, smoothing=0.1, ridge=1e-4)

    def answers(x: float) -> list[float]:
        ids, distances = tree.exact([x], 5)
        near, values = inputs[ids][:, np.newaxis], outputs[ids]
        weights = approximate.local_weights(distances, smoothing=0.1)
        rows = [
            approximate.nearest(values),
            map_query(literal, truth, [x]),
            approximate.kndb(values, distances, alpha=3),
            approximate.kndb2([x], near, values, gradients[ids], distances, alpha=3),
            approximate.local_linear([x], near, values, weights, ridge=1e-4),
            approximate.local_quadratic([x], near, values, weights, ridge=1e-4, curvature_ridge=1e-2),
        ]
        return [float(row[0]) for row in rows]

    names = ["nearest", "leaf maps", "KNDB", "KNDB2", "local linear", "local quadratic"]
    curves = np.array([answers(x) for x in places.tolist()]).T
    figure, axes = plt.subplots(2, 3, figsize=(8, 4.2), sharex=True, sharey=True)
    for panel, name, curve in zip(axes.ravel().tolist(), names, curves, strict=True):
        error = np.sqrt(((curve - truth(places)) ** 2).mean())
        panel.set(title=f"{name}: rms error {error:.3f}", xticks=[], yticks=[])
        panel.plot(places, truth(places), color=PALE, lw=4)
        panel.plot(places, curve, color=LEVELS[1], lw=1.5)
        panel.plot(inputs, outputs, "o", ms=4, color="black")
    drawing.save(figure, "methods")


def changelings() -> None:
    """Appendix C: the error before and after a fifth sample, and the five cases."""
    window: Window = (-5, 5.8, -5.2, 5.6)
    x, y = np.linspace(*window[:2], 220), np.linspace(*window[2:], 220)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    figure, axes = plt.subplots(1, 3, figsize=(8, 2.9))
    errors, reached = [], []
    for panel, known in zip(axes.tolist(), (4, 5), strict=False):
        tree = Tree(examples.CHANGELING_RADII)
        for vector in [*examples.CHANGELING_SAMPLES, examples.CHANGELING_NEW][:known]:
            tree.insert(vector)
        leaves = [tree.path((a, b))[-1] for a, b in places.tolist()]
        error = np.zeros(len(places))
        for leaf in set(leaves):
            here = np.array([other is leaf for other in leaves])
            primary = np.array([tree.points[leaf.sample]])
            matrix = leaf_map(examples.changeling_teacher, tree.points[leaf.sample], tree.radii[leaf.level - 1])
            answer = examples.changeling_teacher(primary) + (places[here] - primary) @ matrix.T
            error[here] = np.abs(answer - examples.changeling_teacher(places[here]))[:, 0]
        errors.append(error.reshape(220, 220))
        reached.append([(leaf.sample, leaf.level) for leaf in leaves])
        drawing.plane(panel, window, f"error with {known} samples")
        panel.pcolormesh(x, y, errors[-1], cmap="Greys", vmin=0, vmax=5)
        drawing.borders(panel, tree, 2)
        drawing.points(panel, tree, ["A", "", "", "", "new"])
        drawing.neighbourhoods(panel, tree)
    changed = np.array([before != after for before, after in zip(*reached, strict=True)]).reshape(220, 220)
    change = np.where(changed, errors[1] - errors[0], np.nan)
    drawing.plane(axes[2], window, "what the new one changes")
    image = axes[2].pcolormesh(x, y, change, cmap="RdBu_r", vmin=-1.5, vmax=1.5)
    figure.colorbar(image, ax=axes[2], shrink=0.75, ticks=[-1.5, 0, 1.5]).ax.set_yticklabels(["falls", "0", "grows"])
    for case, place in examples.CHANGELINGS.items():
        axes[2].annotate(case, place, ha="center", va="center", fontweight="bold", path_effects=drawing.HALO)
    drawing.save(figure, "changelings")


def support() -> None:
    """Support and expected error in one dimension, straight from their formulas."""
    rng = np.random.default_rng(11)
    starts = np.array([0.0, 0.2, 0.6, 1.0, 1.3, 1.6, 6.0, 6.1, 6.4, 6.6])
    inputs = (starts[:, np.newaxis] + rng.uniform(0, 2.2, (10, 8))).ravel()
    groups = np.repeat(np.arange(10), 8)
    outputs = np.sin(inputs) + rng.normal(scale=0.03 + 0.1 * (inputs > 5), size=80)

    def answer(x: float, allowed: NDArray[np.bool_]) -> tuple[float, float]:
        """Local linear regression on the 8 nearest of the samples allowed, and the distance of the nearest."""
        distances = np.where(allowed, np.abs(inputs - x), np.inf)
        near = np.argsort(distances, kind="stable")[:8]
        weights = approximate.local_weights(distances[near], smoothing=0.3)
        rows = inputs[near][:, np.newaxis], outputs[near][:, np.newaxis]
        return float(approximate.local_linear([x], *rows, weights, ridge=1e-3)[0]), float(distances[near[0]])

    left_out = np.array([answer(x, groups != group) for x, group in zip(inputs.tolist(), groups.tolist(), strict=True)])
    residuals, scores = np.abs(left_out[:, 0] - outputs), left_out[:, 1]

    def spread(x: float, allowed: NDArray[np.bool_]) -> float:
        """The mean residual of the 8 nearest samples allowed."""
        return float(residuals[np.argsort(np.where(allowed, np.abs(inputs - x), np.inf), kind="stable")[:8]].mean())

    scales = np.array([spread(x, groups != group) for x, group in zip(inputs.tolist(), groups.tolist(), strict=True)])
    quantile = np.sort(residuals / scales)[int(np.ceil(81 * 0.9)) - 1]
    everything = np.ones(80, np.bool_)
    places = np.linspace(-1.5, 10.5, 500)
    found = np.array([answer(x, everything) for x in places.tolist()])
    error = quantile * np.array([spread(x, everything) for x in places.tolist()])
    trust = (1 + (scores >= found[:, 1:]).sum(axis=1)) / 81
    figure, (above, below) = plt.subplots(2, 1, figsize=(8, 4.6), sharex=True, height_ratios=[2, 1])
    above.plot(places, np.sin(places), color=PALE, lw=4, label="truth")
    above.fill_between(
        places, found[:, 0] - error, found[:, 0] + error, color=LEVELS[1], alpha=0.2, lw=0, label="± expected error"
    )
    above.plot(places, found[:, 0], color=LEVELS[1], lw=1.5, label="answer")
    above.scatter(inputs, outputs, c=groups, cmap="tab10", s=16, zorder=4)
    above.set(ylim=(-1.7, 2.1), xticks=[], yticks=[], title="samples, a colour for each demonstration")
    above.legend(loc="upper right", ncols=3)
    below.plot(places, trust, color=LEVELS[3], lw=1.5)
    below.axhline(0.05, color=QUERY, lw=1, ls="--")
    below.annotate("0.05", (places[-1], 0.05), (-2, 3), textcoords="offset points", ha="right", color=QUERY)
    below.set(xlim=(places[0], places[-1]), ylim=(0, 1.05), yticks=[0, 0.5, 1], xticks=[], title="support")
    drawing.save(figure, "support")


if __name__ == "__main__":
    main()
