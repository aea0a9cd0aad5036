"""Parts of the pictures: the plane with samples and cells, and the tree as a diagram."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from tests.learner.reference import Node, Tree

Floats = NDArray[np.float64]
Window = tuple[float, float, float, float]

PICTURES = Path(__file__).with_name("pictures")

# Colours that colour-blind people can tell apart (Okabe and Ito). Blue, orange and green are always levels 1, 2 and 3.
LEVELS = ["#444444", "#0072B2", "#D55E00", "#009E73"]
QUERY = "#C2185B"
QUIET = "#8A8A8A"
PALE = "#CFCFCF"

WIDTHS = [1.8, 1.2, 0.9]
"""Of the borders below levels 0, 1 and 2."""

RESOLUTION = 700

HALO = [withStroke(linewidth=2.5, foreground="white")]
"""Keeps lines away from letters."""

mpl.rcParams.update(
    {
        "font.size": 9.5,
        "axes.titlesize": 9.5,
        "axes.edgecolor": QUIET,
        "axes.linewidth": 0.6,
        "axes.titlelocation": "left",
        "figure.constrained_layout.use": True,
        "figure.constrained_layout.hspace": 0.06,
        "savefig.dpi": 200,
        "legend.frameon": False,
    }
)


def save(figure: Figure, name: str) -> None:
    """As a PNG that says nothing about where it was made."""
    PICTURES.mkdir(exist_ok=True)
    figure.savefig(PICTURES / f"{name}.png", metadata={"Software": None})
    plt.close(figure)


def plane(axes: Axes, window: Window, title: str) -> None:
    """An empty piece of the input space: x from, x to, y from, y to."""
    axes.set(xlim=window[:2], ylim=window[2:], aspect="equal", xticks=[], yticks=[], title=title)


def points(
    axes: Axes,
    tree: Tree,
    names: Sequence[str],
    *,
    places: dict[str, tuple[float, float]] | None = None,
    new: int = -1,
    quiet: Sequence[int] = (),
) -> None:
    """The samples: nodes in the colour of the highest level on which they stand, others grey; a ring around `new`.

    `places` says where labels stand that would collide above and to the right of their point.
    """
    levels = {node.sample: node.level for node in sorted(tree.nodes(), key=lambda node: -node.level)}
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    for sample, (x, y) in enumerate(tree.points):
        if not (left < x < right and low < y < high):
            continue
        stands = sample in levels and sample not in quiet
        colour = LEVELS[levels[sample]] if stands else QUIET
        axes.plot(x, y, "o", ms=4.5 if stands else 3, color=colour, zorder=5)
        if sample == new:
            axes.plot(x, y, "o", ms=10, mfc="none", mec=colour, mew=1.5, zorder=5)
        dx, dy = (places or {}).get(names[sample], (5.0, 4.0))
        axes.annotate(
            names[sample],
            (x, y),
            (dx, dy),
            textcoords="offset points",
            color=colour,
            zorder=4,
            ha="left" if dx > 0 else "center" if dx == 0 else "right",
            va="bottom" if dy > 0 else "center" if dy == 0 else "top",
            fontweight="bold" if stands else "normal",
            path_effects=HALO,
        )


def borders(axes: Axes, tree: Tree, deepest: int) -> None:
    """The borders of the cells of levels 1 to `deepest`, in their levels' colours."""
    x, y = np.linspace(*axes.get_xlim(), RESOLUTION), np.linspace(*axes.get_ylim(), RESOLUTION)
    places = np.stack(np.meshgrid(x, y), axis=-1)

    def divide(node: Node, cell: NDArray[np.bool_]) -> None:
        if not node.children or node.level == deepest or not cell.any():
            return
        vectors = np.array([tree.points[child.sample] for child in node.children])
        nearest = ((places[:, :, np.newaxis] - vectors) ** 2).sum(axis=-1).argmin(axis=-1)
        for number, child in enumerate(node.children):
            inside = cell & (nearest == number)
            if 0 < inside.sum() < cell.sum():
                shape = np.where(cell, inside, np.nan)
                axes.contour(
                    x, y, shape, [0.5], colors=LEVELS[child.level], linewidths=WIDTHS[node.level], zorder=3 - node.level
                )
            divide(child, inside)

    divide(tree.root, np.ones((RESOLUTION, RESOLUTION), np.bool_))


def circles(axes: Axes, tree: Tree, level: int) -> None:
    """The radius of a level around the nodes that stand on it."""
    for node in tree.nodes():
        if node.level == level:
            centre = tree.points[node.sample]
            axes.add_patch(Circle((centre[0], centre[1]), tree.radii[level - 1], fc=LEVELS[level], alpha=0.1, zorder=0))


def neighbourhoods(axes: Axes, tree: Tree) -> None:
    """The radius of its own level around each leaf: what its map was made for."""
    for leaf in tree.nodes():
        if not leaf.children:
            x, y = tree.points[leaf.sample]
            axes.add_patch(
                Circle((x, y), tree.radii[leaf.level - 1], fc="none", ec=LEVELS[leaf.level], ls="--", zorder=4)
            )


def box(axes: Axes, corners: Floats, colour: str, *, width: float = 1, alpha: float = 0) -> None:
    """The smallest box around points (n, 2)."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    where, size = (float(low[0]), float(low[1])), high - low
    axes.add_patch(Rectangle(where, *size.tolist(), fc=colour, ec="none", alpha=alpha, zorder=0))
    axes.add_patch(Rectangle(where, *size.tolist(), fc="none", ec=colour, lw=width, zorder=2))


def diagram(axes: Axes, tree: Tree, names: Sequence[str], title: str, *, lost: Sequence[Node] = ()) -> None:
    """The tree, root on top; nodes that are `lost` are grey and dashed."""
    place: dict[Node, float] = {}

    def spread(node: Node, leaves: int) -> int:
        """Places what is below; returns how many leaves there are so far."""
        before = leaves
        for child in node.children:
            leaves = spread(child, leaves)
        place[node] = (before + leaves - 1) / 2 if node.children else float(leaves)
        return leaves if node.children else leaves + 1

    last = spread(tree.root, 0)
    for node, x in place.items():
        colour = QUIET if node in lost else LEVELS[node.level]
        if node.parent is not None:
            line = "--" if node in lost else "-"
            axes.plot([place[node.parent], x], [1 - node.level, -node.level], ls=line, color=PALE, lw=1.4, zorder=1)
        axes.annotate(
            names[node.sample] if node is not tree.root else "root",
            (x, -node.level),
            ha="center",
            va="center",
            color=colour,
            fontweight="bold",
            zorder=3,
            bbox={
                "boxstyle": "round,pad=0.22",
                "fc": "white",
                "ec": colour,
                "lw": 1.2,
                "ls": "--" if node in lost else "-",
            },
        )
    depth = max(node.level for node in place)
    axes.set(xlim=(-0.8, last - 0.2), ylim=(-depth - 0.5, 0.5), title=title)
    axes.axis("off")


def query_at(axes: Axes, query: Sequence[float], *, place: tuple[float, float] = (6, -11)) -> None:
    """A query Q."""
    axes.plot(query[0], query[1], "*", ms=12, color=QUERY, zorder=7)
    axes.annotate(
        "Q",
        (query[0], query[1]),
        place,
        textcoords="offset points",
        color=QUERY,
        fontweight="bold",
        zorder=7,
        path_effects=HALO,
    )


def rays(
    axes: Axes, query: Sequence[float], ends: Sequence[Sequence[float]], nearest: Sequence[Sequence[float]]
) -> None:
    """Lines from a query to what it is compared with; full ones to what it goes on with."""
    for end in ends:
        chosen = list(end) in [list(one) for one in nearest]
        axes.plot(
            [query[0], end[0]],
            [query[1], end[1]],
            color=QUERY,
            lw=1.6 if chosen else 0.8,
            ls="-" if chosen else (0, (4, 3)),
            zorder=4,
        )
