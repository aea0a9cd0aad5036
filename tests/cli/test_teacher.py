"""Where the teacher puts cups and which small motions it makes: geometry only, without a lab."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handeye.simulation import grasping, gripper, kinematics, puma
from handeye.simulation.lessons import AROUND_APPROACH, AROUND_GRASP, BEFORE_APPROACH
from handeye.simulation.places import Place, Purpose, draw
from handeye.simulation.scatter import Scatter
from handeye.simulation.scene import WORKSPACE_CENTRE, WORKSPACE_SIZE
from handeye.simulation.teacher import near

CUP_RADIUS = 0.0325

corners = st.sampled_from([(x, y) for x in (-0.5, 0.0, 0.5) for y in (-0.5, 0.0, 0.5)])
seeds = st.integers(0, 2**32 - 1)


def xy(place: Place) -> np.ndarray:
    return np.array([place.x, place.y])


def test_more_places_begin_with_the_same_ones() -> None:
    assert draw(7, Purpose.TESTING, 100)[:10] == draw(7, Purpose.TESTING, 10)


def test_places_for_teaching_and_testing_have_nothing_in_common() -> None:
    taught, tests = draw(7, Purpose.TEACHING, 10), draw(7, Purpose.TESTING, 10)
    distances = [np.linalg.norm(xy(a) - xy(b)) for a in taught for b in tests]
    assert min(distances) > 1e-6
    assert not {place.seed for place in taught} & {place.seed for place in tests}


def test_places_fill_the_workspace_and_stay_in_it() -> None:
    places = np.array([xy(place) for place in draw(3, Purpose.TESTING, 400)])
    away = np.abs(places - WORKSPACE_CENTRE) / (WORKSPACE_SIZE / 2)
    assert away.max() <= 1.0
    assert away.max(axis=0).min() > 0.97
    quarters = {(x > WORKSPACE_CENTRE[0], y > WORKSPACE_CENTRE[1]) for x, y in places}
    assert len(quarters) == 4


@given(corner=corners, seed=seeds, subtask=st.sampled_from(["approach", "grasp"]))
def test_every_small_motion_is_reachable_and_smooth(corner: tuple[float, float], seed: int, subtask: str) -> None:
    scatter = {"approach": AROUND_APPROACH, "grasp": AROUND_GRASP}[subtask]
    goal = grasping.solve_chain(WORKSPACE_CENTRE + WORKSPACE_SIZE * np.array(corner))[subtask]
    for pose in scatter.draw(kinematics.forward(goal), np.random.default_rng(seed)):
        joints = near(pose, goal)
        np.testing.assert_allclose(kinematics.forward(joints), pose, atol=1e-9)
        assert np.all((joints >= puma.LOWER) & (joints <= puma.UPPER))
        assert np.abs(joints - goal).max() < 0.6


@given(seed=seeds)
def test_small_motions_around_the_grasp_do_not_touch_the_cup(seed: int) -> None:
    goal = grasping.grasp_pose(WORKSPACE_CENTRE)
    for pose in AROUND_GRASP.draw(goal, np.random.default_rng(seed)):
        cup_in_tool = np.linalg.inv(pose) @ goal[:, 3]
        assert abs(cup_in_tool[1]) + CUP_RADIUS < gripper.RANGE / 2 - 0.002
        assert -1e-3 < cup_in_tool[2] < 0.045


def test_small_motions_have_all_scales_and_keep_their_bounds() -> None:
    scatter = Scatter(count=400, x=0.01, y=0.02, backward=0.04, forward=0.0, angle=0.05)
    offsets = np.array([pose[:3, 3] for pose in scatter.draw(np.eye(4), np.random.default_rng(1))])
    assert np.all(np.abs(offsets[:, 0]) <= 0.01)
    assert np.all(np.abs(offsets[:, 1]) <= 0.02)
    assert offsets[:, 2].max() <= 0.0
    assert offsets[:, 2].min() == pytest.approx(-0.04, abs=2e-3)
    sizes = np.linalg.norm(offsets, axis=1)
    assert np.quantile(sizes, 0.1) < 0.004 < 0.02 < np.quantile(sizes, 0.9)


@given(seed=seeds, corner=corners)
def test_elsewhere_the_hand_is_held_as_to_grasp_there_and_meets_no_cup_on_its_ways(
    seed: int, corner: tuple[float, float]
) -> None:
    cup = WORKSPACE_CENTRE + WORKSPACE_SIZE * np.array(corner)
    goal = grasping.solve_chain(cup)["approach"]
    places = BEFORE_APPROACH.draw(goal, np.random.default_rng(seed))
    assert len(places) >= BEFORE_APPROACH.count / 2
    assert not np.any(np.array(places)[:, [3, 5]])
    stops = [goal, *places, goal]
    for one, other in itertools.pairwise(stops):
        for share in np.linspace(0.0, 1.0, 20):
            pose = kinematics.forward(one + share * (other - one))
            assert pose[2, 3] > 0.06
            # The fingers end 2 cm beyond the point between them, the cup is 9.5 cm high.
            away = np.hypot(*(pose[:2, 3] - cup))
            assert away > CUP_RADIUS + 0.02 or pose[2, 3] > 0.12
