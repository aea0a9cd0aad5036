"""The referee judges made-up trials; each test spoils one thing."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from handeye.simulation.pose import Pose
from handeye.simulation.scene import ObjectState, WorldState
from handeye.simulation.scoring import CupSize, Track, lowest_point, score

CUP = CupSize(radius=0.0325, height=0.095)
CENTRE = CUP.height / 2
ENDED = {"approach": 2.0, "grasp": 5.0, "lift": 7.0}
PITCH = math.radians(20.0)


def hand(ahead: float = 0.0, sideways: float = 0.0, up: float = 0.0) -> NDArray[np.float64]:
    """world_from_tool of a hand pitched 20° down, so far short of a cup at (0.6, 0) along its approach."""
    z = np.array([math.cos(PITCH), 0.0, -math.sin(PITCH)])
    y = np.array([0.0, 1.0, 0.0])
    tool = np.eye(4)
    tool[:3, :3] = np.column_stack([np.cross(y, z), y, z])
    tool[:3, 3] = np.array([0.6, 0.0, CENTRE + up]) - ahead * z + sideways * y
    return tool


def good_trial(every: float = 0.05) -> Track:
    """Parked; 10 cm short of the cup at 2 s, around it at 4 s, closed at 5 s, up at 7 s; holds until 9.5 s."""
    time = np.arange(0.0, 9.5 + 1e-9, every)
    n = len(time)
    lift = np.clip((time - 5.0) / 2.0, 0.0, 1.0) * 0.13
    ahead = np.interp(time, [0.0, 2.0, 4.0], [0.3, 0.10, 0.0])
    tool = np.stack([hand(ahead=a, up=u) for a, u in zip(ahead, lift, strict=True)])
    cup = np.tile([0.6, 0.0, CENTRE], (n, 1))
    cup[:, 2] += lift
    closing = np.clip((time - 4.0) / 1.0, 0.0, 1.0)
    opening = 0.09 - closing * (0.09 - 2 * CUP.radius)
    touches = np.repeat((closing >= 1.0)[:, None], 2, axis=1)
    return Track(time, cup, np.tile([0.0, 0.0, 1.0], (n, 1)), tool, opening, touches)


def test_a_good_trial_passes_everywhere() -> None:
    result = score(good_trial(), CUP, ENDED)
    assert result.passed == {"approach": True, "grasp": True, "lift": True}
    assert result.miss_mm == pytest.approx(0.0, abs=1e-6)
    assert result.pushed_mm == pytest.approx(0.0, abs=1e-6)


def test_a_subtask_that_was_not_completed_has_not_passed() -> None:
    result = score(good_trial(), CUP, {"approach": 2.0})
    assert result.passed == {"approach": True, "grasp": False, "lift": False}


@pytest.mark.parametrize(
    ("ahead", "sideways", "up", "passed"),
    [
        (0.10, 0.012, 0.0, True),  # 0.012 + radius < half of the opening
        (0.10, 0.013, 0.0, False),
        (0.10, -0.013, 0.0, False),
        (0.10, 0.0, 0.035, True),  # 1 cm below the rim
        (0.10, 0.0, 0.040, False),
        (0.10, 0.0, -0.040, False),
        (-0.01, 0.0, 0.0, False),  # past the cup
        (0.25, 0.0, 0.0, False),  # far too short
    ],
)
def test_approach_needs_the_cup_between_the_fingers_planes(
    ahead: float, sideways: float, up: float, passed: bool
) -> None:
    track = good_trial()
    track.tool[track.at(2.0)] = hand(ahead, sideways, up)
    assert score(track, CUP, ENDED).passed["approach"] is passed


def test_approach_fails_when_the_cup_was_moved_even_if_it_came_back() -> None:
    track = good_trial()
    track.cup[track.at(1.0), 0] += 0.011
    assert not score(track, CUP, ENDED).passed["approach"]


def test_approach_fails_when_the_cup_leans() -> None:
    track = good_trial()
    track.cup_axis[track.at(2.0)] = [math.sin(0.2), 0.0, math.cos(0.2)]
    assert not score(track, CUP, ENDED).passed["approach"]


@pytest.mark.parametrize("finger", [0, 1])
def test_grasp_needs_both_fingers(finger: int) -> None:
    track = good_trial()
    track.touches[:, finger] = False
    assert not score(track, CUP, ENDED).passed["grasp"]


def test_lift_needs_ten_centimetres_for_two_whole_seconds() -> None:
    track = good_trial()
    assert score(track, CUP, ENDED).passed["lift"]
    low = good_trial()
    low.cup[-1, 2] = CENTRE + 0.099
    assert not score(low, CUP, ENDED).passed["lift"]
    early = good_trial()
    early.cup[early.at(9.5 - 2.0), 2] = CENTRE + 0.05
    assert not score(early, CUP, ENDED).passed["lift"]
    before = good_trial()
    before.cup[before.at(9.5 - 2.0) - 1, 2] = CENTRE + 0.05
    assert score(before, CUP, ENDED).passed["lift"]


def test_the_lowest_point_of_a_leaning_cup_is_an_edge() -> None:
    track = good_trial()
    track.cup_axis[-1] = [1.0, 0.0, 0.0]
    assert lowest_point(track, CUP)[-1] == pytest.approx(CENTRE + 0.13 - CUP.radius)
    assert lowest_point(track, CUP)[0] == pytest.approx(0.0)


def test_miss_is_measured_when_closing_begins() -> None:
    track = good_trial()
    track.tool[track.at(4.0), :3, 3] += [0.003, 0.0, 0.004]
    assert score(track, CUP, ENDED).miss_mm == pytest.approx(5.0)


def test_pushed_includes_the_closing_but_not_the_lift() -> None:
    track = good_trial()
    track.cup[track.at(4.5), 1] += 0.002
    track.cup[track.at(6.0), 1] += 0.050
    assert score(track, CUP, ENDED).pushed_mm == pytest.approx(2.0)


def test_a_trial_that_never_closes_is_measured_at_its_end() -> None:
    track = good_trial()
    track.opening[:] = 0.09
    track.tool[-1, :3, 3] = track.cup[-1] + [0.0, 0.3, 0.0]
    result = score(track, CUP, {})
    assert result.miss_mm == pytest.approx(300.0)
    assert not any(result.passed.values())


def test_a_track_is_made_of_the_labs_history() -> None:
    rotation = Rotation.from_euler("xyz", [0.1, -0.2, 0.3])
    states = [
        WorldState(
            world_time=time,
            scene_version=1,
            joints=np.zeros(6),
            fingers=np.array([0.04, 0.041]),
            tool=Pose(np.array([0.1, 0.2, 0.3]), rotation.as_quat()),
            objects=(
                ObjectState("grid", Pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])), True, True),
                ObjectState("cup", Pose(np.array([0.5, 0.0, 0.05]), rotation.as_quat()), True, False),
            ),
        )
        for time in (0.0, 0.5)
    ]
    track = Track.of(states, "cup")
    assert track.time.tolist() == [0.0, 0.5]
    np.testing.assert_allclose(track.cup[1], [0.5, 0.0, 0.05])
    np.testing.assert_allclose(track.cup_axis[0], rotation.as_matrix()[:, 2], atol=1e-12)
    np.testing.assert_allclose(track.tool[0, :3, :3], rotation.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(track.tool[0, :3, 3], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(track.opening, 0.081)
    assert track.touches.tolist() == [[True, False], [True, False]]
    with pytest.raises(KeyError):
        Track.of(states, "mug")
