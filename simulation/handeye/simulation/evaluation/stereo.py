"""CSS on rendered images, as in the thesis's Fig 4.16: 729 intersections of the grid, 365 train, 200 test."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handeye.simulation.evaluation.outcome import Figure, average
from handeye.simulation.evaluation.site import Evaluation, Site, Trial
from handeye.simulation.experimenter import thesis_views
from handeye.simulation.report import Picture

_TRAIN, _TEST = 365, 200
_PICTURED = 2


def _measure(site: Site, seed: int, _trials: int, pictures: list[Picture]) -> list[Trial]:
    """Shows the nine views, trains by a random choice of their intersections, and asks for others."""
    random = np.random.default_rng(seed)
    views = thesis_views(random)
    client = site.client
    with site.progress("showing the grid", len(views)) as advance:

        def shown() -> None:
            if len(pictures) < _PICTURED:
                pictures.append(
                    Picture(client.frame("left"), f"Seed {seed}: the left picture of one of the nine views.")
                )
            advance()

        site.experimenter.show_grid(views, shown)
    samples = list(client.samples("CSS"))
    inputs, outputs = (np.array([getattr(each, name) for each in samples]) for name in ("input", "output"))
    declaration = client.module("CSS").declaration
    client.delete_module("CSS")
    chosen = random.permutation(len(samples))
    train, test = chosen[:_TRAIN], chosen[_TRAIN : _TRAIN + _TEST]
    client.create_module(declaration)
    client.add_samples("CSS", inputs[train], outputs[train])
    errors = 1e3 * (client.query("CSS", inputs[test]).outputs - outputs[test])
    return [{"point": outputs[i].tolist(), "error_mm": each.tolist()} for i, each in zip(test, errors, strict=True)]


def _figures(trials: Sequence[Trial]) -> tuple[Figure, ...]:
    errors = np.array([trial["error_mm"] for trial in trials])
    whole, across = np.linalg.norm(errors, axis=1), np.linalg.norm(errors[:, :2], axis=1)
    return (
        average(f"mean error, {_TRAIN} samples, 85–125 cm", whole, "mm", 1.0, "about 5 mm"),
        average("of it across the line of sight", across, "mm"),
        average("of it in depth", np.abs(errors[:, 2]), "mm"),
    )


def _histograms(trials: Sequence[Trial]) -> dict[str, tuple[float, ...]]:
    return {"Error of single points, in mm": tuple(float(np.linalg.norm(trial["error_mm"])) for trial in trials)}


EVALUATION = Evaluation("css", "Camera-centred stereo (CSS) on rendered images", _measure, _figures, _histograms)
