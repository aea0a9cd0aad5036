from __future__ import annotations

from functools import reduce

import numpy as np
import pybullet
import pytest
from numpy.typing import NDArray

from handeye.simulation import grasping, gripper, kinematics, puma
from handeye.simulation.scene import HAND_LINK, WORKSPACE_CENTRE, WORKSPACE_SIZE
from handeye.simulation.world import World

RNG = np.random.default_rng(1)


def random_joints(count: int) -> NDArray[np.float64]:
    return RNG.uniform(puma.LOWER, puma.UPPER, (count, 6))


def turn(axis: int, angle: float) -> NDArray[np.float64]:
    matrix = np.eye(4)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[i, j], matrix[j, i] = -np.sin(angle), np.sin(angle)
    return matrix


def shift(x: float, y: float, z: float) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def literal_forward(q: NDArray[np.float64]) -> NDArray[np.float64]:
    """The published table, written out: Rz(θ) Tz(d) Tx(a) Rx(α) six times, then the tool."""
    table = [
        (0.0, 0.0, 90),
        (0.0, 0.4318, 0),
        (0.15005, 0.0203, -90),
        (0.4318, 0.0, 90),
        (0.0, 0.0, -90),
        (0.0, 0.0, 0),
    ]
    steps = [shift(*puma.BASE_POSITION)]
    for angle, (d, a, alpha) in zip(q, table, strict=True):
        steps += [turn(2, angle), shift(0, 0, d), shift(a, 0, 0), turn(0, np.radians(alpha))]
    return reduce(np.matmul, [*steps, shift(0, 0, gripper.TOOL_LENGTH)])


def test_forward_is_the_published_chain() -> None:
    for joints in random_joints(100):
        np.testing.assert_allclose(kinematics.forward(joints), literal_forward(joints), atol=1e-9)


def test_forward_agrees_with_pybullet(world: World) -> None:
    stage = world._physics.stage
    for joints in random_joints(20):
        stage.set_joints(joints, np.zeros(2))
        link = pybullet.getLinkState(
            stage.robot, HAND_LINK, computeForwardKinematics=True, physicsClientId=stage.client
        )
        pose = kinematics.forward(joints)
        np.testing.assert_allclose(link[4], pose[:3, 3], atol=1e-5)
        rotation = np.reshape(pybullet.getMatrixFromQuaternion(link[5]), (3, 3))
        np.testing.assert_allclose(rotation, pose[:3, :3], atol=1e-5)


def test_inverse_recovers_2000_of_2000_random_poses() -> None:
    recovered = 0
    for joints in random_joints(2000):
        pose = kinematics.forward(joints)
        solutions = kinematics.inverse(pose)
        assert np.all((solutions >= puma.LOWER) & (solutions <= puma.UPPER))
        difference = np.abs(np.angle(np.exp(1j * (solutions - joints)))).max(axis=1)
        exact = all(np.allclose(kinematics.forward(s), pose, atol=1e-9) for s in solutions)
        recovered += bool(exact and len(solutions) and difference.min() < 1e-6)
    assert recovered == 2000


def test_inverse_finds_eight_different_branches() -> None:
    joints = np.radians([30.0, 80.0, -100.0, 35.0, 40.0, 20.0])
    solutions = kinematics.inverse(kinematics.forward(joints))
    counts = [len(kinematics.inverse(kinematics.forward(q))) for q in random_joints(300)]
    assert max(counts) == 8
    assert len(np.unique(np.round(solutions, 6), axis=0)) == len(solutions) > 1


def test_inverse_of_a_straight_wrist() -> None:
    joints = np.radians([10.0, 60.0, -150.0, 25.0, 0.0, 15.0])
    pose = kinematics.forward(joints)
    solutions = kinematics.inverse(pose)
    assert len(solutions)
    for solution in solutions:
        np.testing.assert_allclose(kinematics.forward(solution), pose, atol=1e-6)


@pytest.mark.parametrize("point", [(3.0, 0.0, 0.2), (-0.15, 0.15, 1.8)])
def test_inverse_of_a_point_out_of_reach_is_empty(point: tuple[float, float, float]) -> None:
    pose = kinematics.forward(grasping.PARK)
    pose[:3, 3] = point
    assert kinematics.inverse(pose).shape == (0, 6)


def test_nearest_takes_the_same_branch_and_turn() -> None:
    joints = np.radians([10.0, 60.0, -150.0, 100.0, 50.0, 200.0])
    solutions = kinematics.inverse(kinematics.forward(joints))
    np.testing.assert_allclose(kinematics.nearest(solutions, joints + 0.01), joints, atol=1e-9)


def test_the_whole_workspace_is_reached_on_one_smooth_branch() -> None:
    steps = np.linspace(-WORKSPACE_SIZE / 2, WORKSPACE_SIZE / 2, 13)
    places = WORKSPACE_CENTRE + np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1)
    chains = np.array([[[grasping.PARK, *grasping.solve_chain(xy).values()] for xy in row] for row in places])
    margin = np.minimum(chains - puma.LOWER, puma.UPPER - chains).min()
    assert margin > np.radians(12)
    assert np.abs(chains[..., 4]).min() > np.radians(14), "too near to the wrist's singularity"
    assert np.array_equal(chains[..., [3, 5]], np.zeros_like(chains[..., [3, 5]]))
    # Neighbours 2.5 cm apart lie close in joint space: no jump between branches.
    assert np.abs(np.diff(chains, axis=0)).max() < 0.35
    assert np.abs(np.diff(chains, axis=1)).max() < 0.35


def test_grasp_pose_is_pitched_down_with_level_fingers() -> None:
    pose = grasping.grasp_pose(np.array([0.7, -0.1]))
    np.testing.assert_allclose(pose[2, 2], -np.sin(grasping.PITCH))
    np.testing.assert_allclose(pose[2, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(kinematics.forward(grasping.solve(pose)), pose, atol=1e-9)
    approach = grasping.approach_pose(np.array([0.7, -0.1]))
    np.testing.assert_allclose(pose[:3, 3] - approach[:3, 3], 0.09 * pose[:3, 2])


def test_lowest_point_sees_fingers_in_the_table() -> None:
    assert kinematics.lowest_point(grasping.PARK) > 0.1
    low = grasping.solve(grasping.grasp_pose(np.array([0.6, 0.0]), 0.005))
    assert kinematics.lowest_point(low) < 0
