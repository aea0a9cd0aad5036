"""The mirror's pictures are the world's own, bit for bit, whatever happens to its objects."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from handeye.robot_bridge.drivers.simulated import SimulatedRobot
from handeye.simulation import gripper, kinematics, objects, rig
from handeye.simulation.camera import Camera, Image
from handeye.simulation.conditions import Conditions
from handeye.simulation.grasping import solve_chain
from handeye.simulation.mirror import Mirror
from handeye.simulation.pose import Pose
from handeye.simulation.profile import Profile
from handeye.simulation.scene import STEP
from handeye.simulation.world import World
from tests.simulation.camera_helpers import HOME, Direct, found_corners, offsets

from .conftest import MakeWorld

PROFILE = Profile.named("default")
PLACE = np.array([0.6, 0.03])


@pytest.fixture(scope="module")
def one_world() -> Iterator[World]:
    with World(PROFILE, seed=5) as there:
        yield there


@pytest.fixture(scope="module")
def mirror(one_world: World) -> Iterator[Mirror]:
    with Mirror(Direct(one_world)) as copy:
        yield copy


@pytest.fixture
def world(one_world: World) -> World:
    one_world.reset(seed=5)
    return one_world


def directly(world: World, name: rig.CameraName, pan: float = HOME[0], tilt: float = HOME[1]) -> Image:
    """The picture drawn at once from the world's own PyBullet client."""
    camera = Camera(name, PROFILE)
    drawing = camera.draw(world._physics.client, rig.camera_from_world(name, pan, tilt))
    return camera.develop(drawing, world.scene().seed, round(world.time / STEP))


def test_pictures_are_the_worlds_own_to_the_bit(world: World, mirror: Mirror) -> None:
    world.place(objects.CUPS["blue cup"], PLACE)
    world.place(objects.CUPS["green mug"], [0.5, -0.2], yaw=1.0)
    robot = SimulatedRobot(world)
    robot.move_to_joints(solve_chain(PLACE)["approach"])
    robot.close_gripper()
    image, world_time = mirror.picture("left", world.time, *HOME)
    assert world_time == world.time
    assert np.array_equal(image, directly(world, "left"))
    turned, _ = mirror.picture("right", world.time, 0.1, -0.5)
    assert np.array_equal(turned, directly(world, "right", 0.1, -0.5))
    assert np.array_equal(mirror.picture("observer", world.time, 0.1, -0.5)[0], directly(world, "observer"))


def test_objects_come_change_and_go(world: World, mirror: Mirror) -> None:
    empty, _ = mirror.picture("left", world.time, *HOME)
    world.place(objects.CUPS["blue cup"], PLACE)
    assert np.array_equal(mirror.picture("left", world.time, *HOME)[0], directly(world, "left"))
    world.place(objects.CUPS["red tumbler"].named("blue cup"), [0.55, -0.1])
    assert np.array_equal(mirror.picture("left", world.time, *HOME)[0], directly(world, "left"))
    world.remove("blue cup")
    world.reset(seed=5)
    assert np.array_equal(mirror.picture("left", world.time, *HOME)[0], empty)


def test_a_held_ball_shows_where_its_centre_is(world: World, mirror: Mirror) -> None:
    centre = np.array([0.8, 0.05, 0.3])
    empty, _ = mirror.picture("left", world.time, *HOME)
    world.hold(objects.BALL, Pose(centre, np.array([0.0, 0.0, 0.0, 1.0])))
    image, world_time = mirror.picture("left", world.time, *HOME)
    assert world_time == 0.0
    assert np.array_equal(image, directly(world, "left"))
    there = np.argwhere((image.astype(int) - empty).min(axis=2) < -60)
    assert there.mean(axis=0) == pytest.approx(rig.project(centre, "left", *HOME, PROFILE), abs=0.5)
    # A disc: as wide as high, and filled as a circle fills its square.
    height, width = np.ptp(there, axis=0) + 1
    assert height == pytest.approx(width, abs=1)
    assert len(there) / (height * width) == pytest.approx(np.pi / 4, abs=0.05)


def test_grid_points_are_where_the_grid_is_drawn(make_world: MakeWorld) -> None:
    profile = Profile.named("ideal")
    world = make_world("ideal")
    # Before the left camera, its upper face to it, rolled by 0.1 rad. A board that is seen exactly from the front and
    # is not rolled has an rms of 0.14 px or more: its edges lie along the pixels, and supersampling quantises them.
    world_from_camera = np.linalg.inv(rig.left_from_world(*HOME))
    camera_from_board = np.eye(4)
    c, s = np.cos(0.1), np.sin(0.1)
    camera_from_board[:3, :3] = [[c, -s, 0.0], [-s, -c, 0.0], [0.0, 0.0, -1.0]]
    camera_from_board[:3, 3] = [0.0, 0.0, 0.8]
    pose = Pose.from_matrix(world_from_camera @ camera_from_board)
    world.hold(objects.GRID, pose)
    with Mirror(Direct(world)) as mirror:
        image, _ = mirror.picture("left", world.time, *HOME)
    found = found_corners(image)
    points = objects.grid_points(objects.GRID) @ pose.matrix()[:3, :3].T + pose.position
    assert len(found) == len(points)
    off = offsets(found, rig.project(points, "left", *HOME, profile))
    assert np.sqrt((off**2).sum(axis=1).mean()) < 0.1


def test_the_past_is_shown_as_it_was(world: World, mirror: Mirror) -> None:
    before = directly(world, "right")
    robot = SimulatedRobot(world)
    robot.adjust_joints(np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]))
    world.place(objects.CUPS["blue cup"], PLACE)
    assert np.array_equal(mirror.picture("right", 0.0, *HOME)[0], before)


def test_an_unchanged_picture_is_not_drawn_again(world: World, mirror: Mirror) -> None:
    first, _ = mirror.picture("left", 0.0, *HOME)
    assert mirror.picture("left", 0.0, *HOME)[0] is first
    assert mirror.picture("left", 0.0, 0.01, HOME[1])[0] is not first
    world.step()
    assert np.array_equal(mirror.picture("left", 0.0, *HOME)[0], first)


def test_the_marker_is_seen_at_every_pose_of_a_grasp(world: World, mirror: Mirror) -> None:
    """What perception needs of the rig: the hand's marker in both pictures at park, approach and grasp."""
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(gripper.MARKER_DICTIONARY))
    world.place(objects.CUPS["blue cup"], PLACE)
    robot = SimulatedRobot(world)
    chain = solve_chain(PLACE)
    for joints in (robot.description.park, chain["approach"], chain["grasp"]):
        robot.move_to_joints(joints)
        marker = (kinematics.forward(world.state().joints) @ gripper.TOOL_FROM_MARKER)[:3, 3]
        for name in rig.CAMERAS[:2]:
            image, _ = mirror.picture(name, world.time, *HOME)
            corners, found, _ = detector.detectMarkers(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
            assert found is not None
            assert found.ravel().tolist() == [gripper.MARKER_ID]
            centre = corners[0][0].mean(axis=0)[::-1]
            assert centre == pytest.approx(rig.project(marker, name, *HOME, PROFILE), abs=1.0)


def test_a_bumped_head_sees_from_where_it_really_points(world: World, mirror: Mirror) -> None:
    world.reset(5, Conditions(head_bump=(0.03, -0.02)))
    image, _ = mirror.picture("left", world.time, *HOME)
    assert np.array_equal(image, directly(world, "left", HOME[0] + 0.03, HOME[1] - 0.02))
