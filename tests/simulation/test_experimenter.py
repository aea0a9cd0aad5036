"""Where the experimenter holds things: in view of both cameras, and where it says they are."""

from __future__ import annotations

import json
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from handeye.cli.up import Clock
from handeye.simulation import rig
from handeye.simulation.evaluation import site
from handeye.simulation.evaluation.outcome import Earlier, Outcome, average, share
from handeye.simulation.evaluation.saccade import after
from handeye.simulation.evaluation.site import Evaluation, Trial
from handeye.simulation.experimenter import GridView, evenly, thesis_views, volume_views
from handeye.simulation.objects import GRID
from handeye.simulation.profile import Profile


@pytest.mark.parametrize("seed", range(3))
def test_grids_are_whole_in_both_pictures(seed: int) -> None:
    random = np.random.default_rng(seed)
    world_from_camera = np.linalg.inv(rig.left_from_world(0.0, 0.0))
    for view in (*thesis_views(random), *volume_views(random)):
        points = view.points() @ world_from_camera[:3, :3].T + world_from_camera[:3, 3]
        for camera in ("left", "right"):
            shown = rig.project(points, camera, 0.0, 0.0, Profile.named("default"))
            assert (shown > 5.0).all()
            assert (shown < [474.0, 634.0]).all()


def test_points_are_read_as_a_page_by_the_camera() -> None:
    points = GridView(GRID, (0.1, 0.0, 1.0), (0.1, 0.0, 0.0)).points()
    x, y, depth = np.moveaxis(points, -1, 0)
    assert (np.diff(x, axis=1) > 0.0).all()
    assert (np.diff(y, axis=0) > 0.0).all()
    # Its upper face is nearer than its middle.
    np.testing.assert_allclose(depth, 1.0 - GRID.height / 2 - 0.0005)
    np.testing.assert_allclose(points.mean(axis=(0, 1))[:2], [0.1, 0.0], atol=1e-9)


def test_views_fill_the_volume() -> None:
    points = np.concatenate([view.points().reshape(-1, 3) for view in volume_views(np.random.default_rng(0))])
    assert points[:, 2].min() < 0.52
    assert points[:, 2].max() > 1.45
    assert np.ptp(points[:, 0] / points[:, 2]) > 0.5
    assert np.ptp(points[:, 1] / points[:, 2]) > 0.5


@pytest.mark.parametrize("seed", [0, 7])
def test_points_are_spread_evenly(seed: int) -> None:
    points = np.array(list(islice(evenly(5, seed), 64)))
    assert ((points >= 0.0) & (points < 1.0)).all()
    for column in points.T:
        assert np.histogram(column, 4, (0.0, 1.0))[0].min() >= 12
    assert not np.array_equal(points, list(islice(evenly(5, seed + 1), 64)))


def test_figures_have_intervals() -> None:
    # 95 of 100: Wilson's interval is 88.8 to 97.8 %.
    figure = share("reached", [True] * 95 + [False] * 5, 95.0)
    assert (figure.value, figure.met) == (95.0, True)
    assert [figure.low, figure.high] == pytest.approx([88.8, 97.8], abs=0.1)
    assert share("reached", [True] * 94 + [False] * 6, 95.0).met is False
    assert all(
        share("reached", [False] * n).low >= 0.0 and share("reached", [True] * n).high <= 100.0 for n in range(1, 99)
    )
    values = np.random.default_rng(0).normal(3.0, 1.0, 400)
    mean = average("error", values, "mm", 2.5)
    assert mean.met is False
    assert mean.low < 3.0 < mean.high
    assert mean.high - mean.low == pytest.approx(4 * 1.0 / 20.0, rel=0.15)
    assert average("error", values, "mm").met is None


def test_an_outcome_is_a_page_and_numbers(tmp_path: Path) -> None:
    figures = (average("error", [1.0, 2.0, 3.0], "mm", 1.0, "5 mm"), share("reached", [True, False], 95.0))
    trials = ({"seed": 1, "error_mm": [0.12345678, 1.0]},)
    outcome = Outcome("try", "A <title>", (1, 2), figures, trials, {"Error, in mm": (0.5, 1.5)}, (), 3.0)
    outcome.write(tmp_path)
    told = json.loads((tmp_path / "try.json").read_text())
    assert told["trials"] == [{"seed": 1, "error_mm": [0.123457, 1.0]}]
    assert [each["met"] for each in told["figures"]] == [False, False]
    page = (tmp_path / "try.html").read_text()
    assert "A &lt;title&gt;" in page
    assert page.count("missed</span>") == 2
    assert "Error, in mm" in page


def test_trials_of_other_seeds_are_pooled_with_those_of_before(tmp_path: Path) -> None:
    assert Earlier.read(tmp_path, "try", [1]) == Earlier()
    trials = tuple({"seed": seed, "error_mm": float(seed)} for seed in (1, 2, 2))
    Outcome("try", "A title", (1, 2), (), trials, {}, (), 3.0).write(tmp_path)
    assert Earlier.read(tmp_path, "try", [2, 3]) == Earlier(trials[:1], 3.0)


def test_figures_are_made_of_the_trials_of_before_too(monkeypatch: pytest.MonkeyPatch) -> None:
    def told(_evaluation: Evaluation, seed: int, *_: object) -> list[Trial]:
        return [{"error_mm": float(seed)}]

    monkeypatch.setattr(site, "_measured", told)
    evaluation = Evaluation(
        "try",
        "A title",
        lambda *_: [],
        lambda trials: (average("error", [each["error_mm"] for each in trials], "mm"),),
        lambda _trials: {},
    )
    earlier = Earlier(({"seed": 1, "error_mm": 1.0},), 5.0)
    found = list(site.run(evaluation, [3, 5], 1, Clock.LOCKSTEP, Console(), earlier))
    assert [each.seeds for each in found] == [(1, 3), (1, 3, 5)]
    assert [each.figures[0].value for each in found] == [2.0, 3.0]
    assert found[-1].seconds > 5.0


def test_what_was_centred_before_stays_so() -> None:
    assert after([200.0, 4.0, 0.7], 1) == 4.0
    assert after([200.0, 4.0, 0.7], 3) == 0.7
    assert after([0.5], 1) == 0.5
