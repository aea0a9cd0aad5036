"""What the teacher shows: geometry only, without a lab."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from handeye.simulation import grasping, kinematics, puma, rig
from handeye.simulation.gripper import TOOL_FROM_MARKER
from handeye.simulation.lessons import AROUND_RELEASE, CUPS_AREA, JARS_AREA, LESSONS, Lesson
from handeye.simulation.objects import CUPS, JAR
from handeye.simulation.places import Purpose
from handeye.simulation.pose import Pose
from handeye.simulation.pouring import SHORT, TURNS, pouring_chain
from handeye.simulation.scene import ObjectState, WorldState
from handeye.simulation.teacher import near

CUP = CUPS["blue cup"]
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
HOME = rig.rig().head.home

corners = st.tuples(*(st.sampled_from([-0.5, 0.0, 0.5]) for _ in range(4)))


def standing(lesson: Lesson, corner: tuple[float, float, float, float]) -> WorldState:
    """A lesson's two objects at corners or in the middle of their areas."""
    places = [
        np.array(area.centre) + area.size * np.array(offset)
        for area, offset in ((CUPS_AREA, corner[:2]), (JARS_AREA, corner[2:]))
    ]
    return WorldState(
        world_time=0.0,
        scene_version=1,
        joints=grasping.PARK,
        fingers=np.full(2, 0.045),
        tool=Pose(np.zeros(3), UPRIGHT),
        objects=tuple(
            ObjectState(spec.name, Pose(np.array([*place, spec.height / 2]), UPRIGHT), False, False)
            for spec, place in zip(lesson.objects, places, strict=True)
        ),
    )


@pytest.mark.parametrize("name", ["pour", "stack"])
@settings(deadline=None, max_examples=30)
@given(corner=corners, seed=st.integers(0, 2**32 - 1))
def test_every_posture_and_small_motion_can_be_reached(
    name: str, corner: tuple[float, float, float, float], seed: int
) -> None:
    lesson = LESSONS[name](CUP)
    random = np.random.default_rng(seed)
    before = grasping.PARK
    for move in lesson.plan(standing(lesson, corner)):
        goal = move.goal
        assert goal is not None
        joints = [goal, *(each for each in move.way if not isinstance(each, float))]
        if move.scatter is not None:
            joints += [near(pose, goal) for pose in move.scatter.draw(kinematics.forward(goal), random)]
        for each in joints:
            assert np.all((each >= puma.LOWER) & (each <= puma.UPPER))
        # One branch: no joint but the last turns far, which a straight motion would sweep through things.
        assert np.abs(goal - before)[1:5].max() < 1.6
        assert np.abs(np.array(joints) - goal)[:, :5].max() < 0.7
        before = joints[-1] if move.way else goal


@pytest.mark.parametrize("name", ["pour", "stack"])
@settings(deadline=None, max_examples=30)
@given(corner=corners)
def test_both_cameras_see_all_that_a_look_is_about(name: str, corner: tuple[float, float, float, float]) -> None:
    lesson = LESSONS[name](CUP)
    world = standing(lesson, corner)
    for spec in lesson.objects:
        x, y, _ = world.object(spec.name).pose.position
        for side in (-spec.radius, spec.radius):
            assert rig.in_view(np.array([x, y + side, 0.0]), *HOME, 5.0)
            assert rig.in_view(np.array([x, y + side, spec.height]), *HOME, 5.0)
    for move in lesson.plan(world):
        assert move.goal is not None
        marker = (kinematics.forward(move.goal) @ TOOL_FROM_MARKER)[:3, 3]
        assert rig.in_view(marker, *HOME, 30.0)


def test_the_lip_stays_over_the_jar_while_the_cup_is_emptied() -> None:
    jar = np.array([0.55, 0.15])
    chain = pouring_chain(jar, JAR, CUP, grasping.solve_chain(np.array([0.5, -0.15]))["grasp"])
    tool_from_cup = np.eye(4)
    tool_from_cup[:3, :3] = grasping.grasp_pose(jar)[:3, :3].T
    for turn, joints in list(zip(TURNS, chain["turned"], strict=True))[1:]:
        pose = kinematics.forward(joints) @ tool_from_cup
        around = np.linspace(0.0, 2 * np.pi, 400)
        rim = np.column_stack([CUP.radius * np.cos(around), CUP.radius * np.sin(around), np.full(400, CUP.height / 2)])
        places = rim @ pose[:3, :3].T + pose[:3, 3]
        lip = places[np.argmin(places[:, 2])]
        assert np.hypot(*(lip[:2] - jar)) < SHORT + 0.012, turn
        assert 0.03 < lip[2] - JAR.height < 0.04


def test_what_is_held_never_comes_lower_than_where_it_is_let_go() -> None:
    pose = grasping.grasp_pose(np.array([0.5, 0.0]))
    heights = [each[2, 3] for each in AROUND_RELEASE.draw(pose, np.random.default_rng(1))]
    assert min(heights) >= pose[2, 3]
    assert max(heights) > pose[2, 3] + 0.005


@pytest.mark.parametrize("name", ["pour", "stack"])
def test_places_for_teaching_and_testing_have_nothing_in_common(name: str) -> None:
    lesson = LESSONS[name](CUP)
    taught, tests = (lesson.draw(5, purpose, 10) for purpose in (Purpose.TEACHING, Purpose.TESTING))
    assert taught == lesson.draw(5, Purpose.TEACHING, 20)[:10]
    assert not {each.seed for places in taught for each in places} & {each.seed for places in tests for each in places}
    for places in (*taught, *tests):
        for place, area in zip(places, (CUPS_AREA, JARS_AREA), strict=True):
            assert np.abs(np.array([place.x, place.y]) - area.centre).max() <= area.size / 2
