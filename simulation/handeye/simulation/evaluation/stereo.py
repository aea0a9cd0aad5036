"""CSS on rendered images, as in the thesis's Fig 4.16: 729 intersections of the grid, 365 train, 200 test."""

from __future__ import annotations

import numpy as np

from handeye.simulation.evaluation.outcome import Outcome, average
from handeye.simulation.evaluation.site import Site
from handeye.simulation.experimenter import thesis_views

TITLE = "Camera-centred stereo (CSS) on rendered images"

_TRAIN, _TEST = 365, 200
_THESIS = "about 5 mm"


def evaluate(site: Site, seed: int, _trials: int) -> Outcome:
    """Shows the nine views, trains by a random choice of their intersections, and asks for others."""
    random = np.random.default_rng(seed)
    views = thesis_views(random)
    with site.progress("showing the grid", len(views)) as advance:
        site.experimenter.show_grid(views, advance)
    client = site.client
    samples = list(client.samples("CSS"))
    inputs, outputs = (np.array([getattr(each, name) for each in samples]) for name in ("input", "output"))
    declaration = client.module("CSS").declaration
    client.delete_module("CSS")
    chosen = random.permutation(len(samples))
    train, test = chosen[:_TRAIN], chosen[_TRAIN : _TRAIN + _TEST]
    client.create_module(declaration)
    client.add_samples("CSS", inputs[train], outputs[train])
    errors = 1e3 * (client.query("CSS", inputs[test]).outputs - outputs[test])
    whole = np.linalg.norm(errors, axis=1)
    return Outcome(
        "css",
        TITLE,
        (seed,),
        (
            average(f"mean error, {_TRAIN} samples, 85–125 cm", whole, "mm", 1.0, _THESIS),
            average("of it across the line of sight", np.linalg.norm(errors[:, :2], axis=1), "mm"),
            average("of it in depth", np.abs(errors[:, 2]), "mm"),
        ),
        tuple({"point": outputs[i].tolist(), "error_mm": each.tolist()} for i, each in zip(test, errors, strict=True)),
        {"Error of single points, in mm": tuple(whole.tolist())},
    )
