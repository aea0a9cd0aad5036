"""The results as pictures: time against the number of points, a panel for each generated set."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.learner.measure import RECALL, K, Result
from benchmarks.learner.systems import ANSWER, BASE, BEAM, EXACT

COLOURS = {
    ANSWER: "#c1121f",
    EXACT: "#e85d04",
    BEAM: "#faa307",
    "brute force (numba)": "#6c757d",
    "scipy cKDTree": "#1d3557",
    "pykdtree": "#3a86ff",
    "scikit-learn KDTree": "#8ecae6",
    "faiss flat": "#adb5bd",
    "hnswlib": "#2d6a4f",
    "faiss HNSW": "#80b918",
}
OURS = (ANSWER, EXACT, BEAM)


def draw(results: Sequence[Result], directory: Path) -> None:
    """Writes results.png, one query per call, and batches.png, ratios to `BASE`; nothing for sets of one size."""
    _panels(
        results,
        lambda each: each.single.median,
        f"one query per call from Python, k = {K} (µs)",
        directory / "results.png",
    )
    _panels(
        results,
        lambda each: each.batch.to_base,
        f"batches, k = {K}: time in times that of {BASE}",
        directory / "batches.png",
    )


def _panels(results: Sequence[Result], value: Callable[[Result], float], label: str, path: Path) -> None:
    from matplotlib.figure import Figure

    sets = [name for name in dict.fromkeys(each.points for each in results) if len(_sizes(results, name)) > 1]
    if not sets:
        return
    rows = (len(sets) + 1) // 2
    figure = Figure(figsize=(12, 0.8 + 3.6 * rows), layout="constrained")
    panels = figure.subplots(rows, min(len(sets), 2), sharex=True, sharey=True, squeeze=False).flatten()
    lines: dict[str, Any] = {}
    for panel, name in zip(panels, sets, strict=False):
        for system in dict.fromkeys(each.system for each in results):
            mine = [each for each in results if each.points == name and each.system == system]
            ours = system in OURS
            (lines[system],) = panel.loglog(
                [each.n for each in mine],
                [value(each) for each in mine],
                color=COLOURS[system],
                linewidth=3 if ours else 1.2,
                marker="o",
                markersize=5 if ours else 3,
                zorder=3 if ours else 2,
            )
        panel.set_title(name)
        panel.grid(visible=True, which="major", alpha=0.4)
        panel.grid(visible=True, which="minor", alpha=0.12)
    for panel in panels[len(sets) :]:
        panel.set_axis_off()
    figure.supxlabel("points")
    figure.supylabel(label)
    note = f"graphs and beam: recall {RECALL}"
    figure.legend(list(lines.values()), list(lines), loc="outside right center", frameon=False, title=note)
    figure.savefig(path, dpi=110)


def _sizes(results: Sequence[Result], name: str) -> set[int]:
    return {each.n for each in results if each.points == name}
