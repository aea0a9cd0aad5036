"""What an evaluation of pursuit makes of its looks."""

from __future__ import annotations

import numpy as np
import pytest

from handeye.client.models import PursuitLook
from handeye.simulation.evaluation.outcome import quantile
from handeye.simulation.evaluation.pursuit import EVALUATION, LEAST, LOWER, SPEEDS, UPPER, across, lost
from handeye.simulation.evaluation.reaching import towards
from handeye.simulation.rig import left_from_world


def look(time: float, offset: float | None) -> PursuitLook:
    return PursuitLook(
        number=0,
        world_time=time,
        pan=0.0,
        tilt=0.0,
        point=None,
        offset=offset,
        turn=(),
        support=None,
        rate=(),
        late=None,
    )


def test_a_push_leads_across_the_table() -> None:
    random = np.random.default_rng(3)
    headings = []
    for _ in range(200):
        start, goal = across(random)
        for place in (start, goal):
            assert (place >= LOWER - 1e-9).all()
            assert (place <= UPPER + 1e-9).all()
            assert np.min(np.abs([place - LOWER, place - UPPER])) < 1e-9
        assert np.linalg.norm(goal - start) >= LEAST
        headings.append(np.arctan2(*(goal - start)))
    assert np.ptp(headings) > 6.0


@pytest.mark.parametrize(
    ("offsets", "share"),
    [((1.0, 1.0, 1.0, 1.0), 0.0), ((1.0, None, 1.0, 1.0), 0.25), ((1.0, 1.0, None), 0.5), ((None,), 1.0), ((), 1.0)],
)
def test_time_is_lost_from_a_look_that_misses_it_to_the_next(offsets: tuple[float | None, ...], share: float) -> None:
    looks = [look(10.0 + number, offset) for number, offset in enumerate(offsets)]
    assert lost(looks, 4.0) == pytest.approx(share)


def test_the_figures_tell_of_each_speed() -> None:
    trials = [
        {"speed": speed, "times": [1.0, 2.0], "offsets": [0.0, 100 * speed], "late": [0.6, None], "lost": 0.0}
        for speed in SPEEDS
    ]
    figures = {figure.name: figure for figure in EVALUATION.figures(trials)}
    assert figures["2 cm/s: mean offset"].value == pytest.approx(1.0)
    assert figures["15 cm/s: mean offset"].value == pytest.approx(7.5)
    assert figures["all speeds: mean offset"].count == 8
    assert figures["time from picture to picture"].value == 1.0
    assert set(EVALUATION.histograms(trials)) == {f"Offset in each picture at {100 * s:g} cm/s, in px" for s in SPEEDS}


def test_a_quantile_has_its_interval() -> None:
    figure = quantile("95 %", np.arange(101.0), 0.95, "px")
    assert figure.value == pytest.approx(95.0)
    assert figure.low < figure.value < figure.high


def test_a_head_that_looks_towards_a_place_has_it_before_its_cameras() -> None:
    place = np.array([0.6, 0.2, 0.05])
    x, y, z = (left_from_world(*towards(place)) @ [*place, 1.0])[:3]
    assert z > 0.8
    assert abs(x) / z < 0.3
    assert abs(y) / z < 0.1
