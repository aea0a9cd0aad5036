from __future__ import annotations

import itertools
from collections.abc import Iterator

import cv2
import numpy as np
import pybullet
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handeye.simulation import grasping, gripper, kinematics, rig
from handeye.simulation.objects import CUPS, GRID, grid_pitch, grid_points
from handeye.simulation.pose import Pose, quaternion, rotation
from handeye.simulation.profile import Profile
from handeye.simulation.scene import WORKSPACE_CENTRE, WORKSPACE_SIZE, Stage, build
from handeye.simulation.world import World


@pytest.fixture
def stage() -> Iterator[Stage]:
    client = pybullet.connect(pybullet.DIRECT)
    try:
        yield build(client, [CUPS["blue cup"]])
    finally:
        pybullet.disconnect(physicsClientId=client)


def test_a_mirror_stands_as_its_world(stage: Stage) -> None:
    with World(Profile.named("default"), seed=3) as world:
        world.place(CUPS["blue cup"], (0.6, 0.1), yaw=1.0)
        state = world.state()
        stage.apply(state)
        position, orientation = pybullet.getBasePositionAndOrientation(
            stage.objects["blue cup"], physicsClientId=stage.client
        )
        assert np.array_equal(position, state.object("blue cup").pose.position)
        # Bullet normalises quaternions: the last bit may differ.
        np.testing.assert_allclose(orientation, state.object("blue cup").pose.orientation, atol=1e-15)
        joints = pybullet.getJointStates(stage.robot, range(6), physicsClientId=stage.client)
        assert np.array_equal([joint[0] for joint in joints], state.joints)
        world.remove("blue cup")
        stage.apply(world.state())
        assert (
            pybullet.getBasePositionAndOrientation(stage.objects["blue cup"], physicsClientId=stage.client)[0][2] < -1
        )


def test_marker_faces_the_rig_at_park() -> None:
    marker = kinematics.forward(grasping.PARK) @ gripper.TOOL_FROM_MARKER
    to_rig = np.array([1.42, 0.0, 0.66]) - marker[:3, 3]
    assert marker[:3, 2] @ to_rig / np.linalg.norm(to_rig) > np.cos(np.radians(25))


@pytest.mark.parametrize("camera", ["left", "right"])
def test_no_edge_of_the_marker_lies_along_pixels(camera: rig.CameraName) -> None:
    """Where cups stand: along a row or column of pixels, where an edge lies could hardly be seen."""
    half = gripper.MARKER_SIDE / 2
    square = np.array([[-half, half, 0, 1], [half, half, 0, 1], [half, -half, 0, 1], [-half, -half, 0, 1]])
    for x, y in itertools.product(np.linspace(-0.5, 0.5, 5), repeat=2):
        for joints in grasping.solve_chain(WORKSPACE_CENTRE + WORKSPACE_SIZE * np.array([x, y])).values():
            corners = square @ (kinematics.forward(joints) @ gripper.TOOL_FROM_MARKER).T
            seen = rig.project(corners[:, :3], camera, *rig.rig().head.home, Profile.named("default"))
            rows, columns = (np.roll(seen, -1, axis=0) - seen).T
            off = np.abs((np.degrees(np.arctan2(rows, columns)) + 45.0) % 90.0 - 45.0)
            assert off.min() > 12.0


def test_grid_has_nine_by_nine_intersections_in_forty_centimetres(stage: Stage) -> None:
    assert grid_pitch(GRID) == pytest.approx(0.05)
    stage.remove("blue cup")
    body = stage.add(GRID)
    pybullet.resetBasePositionAndOrientation(body, (0.75, 0, 0.003), (0, 0, 0, 1), physicsClientId=stage.client)
    view = pybullet.computeViewMatrix((0.75, 0, 1.2), (0.75, 0, 0), (1, 0, 0))
    lens = pybullet.computeProjectionMatrixFOV(45, 1.0, 0.05, 5.0)
    image = pybullet.getCameraImage(
        800, 800, view, lens, shadow=0, renderer=pybullet.ER_TINY_RENDERER, physicsClientId=stage.client
    )[2]
    grey = cv2.cvtColor(np.reshape(image, (800, 800, 4))[:, :, :3].astype(np.uint8), cv2.COLOR_RGB2GRAY)
    found, corners = cv2.findChessboardCornersSB(grey, (9, 9))
    assert found
    scale = 400 / np.tan(np.radians(22.5)) / (1.2 - 0.0065)
    span = np.ptp(corners.reshape(-1, 2), axis=0) / scale
    np.testing.assert_allclose(span, 0.40, atol=2e-3)


def test_grid_points_are_in_the_order_of_a_picture() -> None:
    points = grid_points(GRID)
    assert points.shape == (81, 3)
    expected = np.array([[-0.2, 0.2], [-0.15, 0.2], [-0.2, 0.15], [0.0, 0.0], [0.2, -0.2]])
    np.testing.assert_allclose(points[[0, 1, 9, 40, 80], :2], expected, atol=1e-15)
    np.testing.assert_allclose(points[:, 2], 0.0035)


unit = st.floats(-1, 1)


@given(unit, unit, unit, unit)
def test_quaternions_and_rotations_agree(x: float, y: float, z: float, w: float) -> None:
    vector = np.array([x, y, z, w])
    length = np.linalg.norm(vector)
    if length < 1e-3:
        return
    matrix = rotation(vector / length)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(rotation(quaternion(matrix)), matrix, atol=1e-12)
    expected = np.reshape(pybullet.getMatrixFromQuaternion((vector / length).tolist()), (3, 3))
    np.testing.assert_allclose(matrix, expected, atol=1e-12)


def test_pose_survives_its_matrix() -> None:
    pose = Pose(np.array([0.1, 0.2, 0.3]), np.array([0.5, 0.5, -0.5, 0.5]))
    back = Pose.from_matrix(pose.matrix())
    np.testing.assert_allclose(back.position, pose.position)
    np.testing.assert_allclose(back.orientation, pose.orientation)


def test_profiles_are_known_by_name() -> None:
    assert Profile.named("ideal").backlash == 0.0
    assert Profile.named("default").backlash == pytest.approx(np.radians(0.1))
    with pytest.raises(ValueError, match="known are default, ideal"):
        Profile.named("perfect")
