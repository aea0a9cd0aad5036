"""Rig, lens and projection agree with each other and with the rendered pictures."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from handeye.simulation import lens, rig
from handeye.simulation.camera import Camera
from handeye.simulation.profile import Profile
from tests.simulation.camera_helpers import HOME, Grid, found_corners, offsets

IDEAL, DEFAULT = Profile.named("ideal"), Profile.named("default")
STEREO: tuple[rig.CameraName, rig.CameraName] = ("left", "right")
ANGLE = st.floats(-1.2, 1.2)


@pytest.fixture(scope="module")
def grid() -> Iterator[Grid]:
    with closing(Grid()) as target:
        yield target


@given(pan=ANGLE, tilt=ANGLE)
def test_cameras_are_parallel_and_a_baseline_apart(pan: float, tilt: float) -> None:
    left, right = (rig.camera_from_world(name, pan, tilt) for name in STEREO)
    assert left == pytest.approx(rig.left_from_world(pan, tilt))
    right_from_left = right @ np.linalg.inv(left)
    assert right_from_left[:3, :3] == pytest.approx(np.eye(3), abs=1e-12)
    assert right_from_left[:3, 3] == pytest.approx([-0.3175, 0.0, 0.0], abs=1e-12)
    assert left[:3, :3] @ left[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)


def test_pan_turns_left_and_tilt_looks_up() -> None:
    point = np.array([0.6, 0.0, 0.1])
    straight = rig.project(point, "left", 0.0, HOME[1], IDEAL)
    panned = rig.project(point, "left", 0.05, HOME[1], IDEAL)
    tilted = rig.project(point, "left", 0.0, HOME[1] + 0.05, IDEAL)
    assert panned[1] > straight[1] + 20  # the head turned to its left: the point moved to the right
    assert tilted[0] > straight[0] + 20  # the head looks up: the point moved down


def test_disparity_measures_depth() -> None:
    point = np.array([0.55, 0.1, 0.2])
    left, right = (rig.project(point, name, 0.1, -0.6, IDEAL) for name in STEREO)
    depth = (rig.left_from_world(0.1, -0.6) @ np.append(point, 1.0))[2]
    assert left[0] == pytest.approx(right[0])
    assert left[1] - right[1] == pytest.approx(600.0 * 0.3175 / depth)


def test_what_is_behind_the_camera_has_no_place_in_the_picture() -> None:
    assert np.isnan(rig.project([3.0, 0.0, 1.0], "left", 0.0, 0.0, IDEAL)).all()


def test_the_workspace_is_well_in_both_pictures_from_home() -> None:
    box = np.array(list(itertools.product((0.43, 0.77), (-0.18, 0.18), (0.0, 0.30))))
    for name in STEREO:
        pixels = rig.project(box, name, *HOME, DEFAULT)
        assert pixels.min() > 30
        assert pixels[:, 0].max() < 480 - 30
        assert pixels[:, 1].max() < 640 - 30


@given(x=st.floats(-0.6, 0.6), y=st.floats(-0.45, 0.45), k1=st.floats(-0.12, 0.12), k2=st.floats(-0.02, 0.02))
def test_undistort_inverts_distort(x: float, y: float, k1: float, k2: float) -> None:
    points = np.array([[x, y]])
    assert lens.undistort(lens.distort(points, k1, k2), k1, k2) == pytest.approx(points, abs=1e-12)


@given(x=st.floats(-0.5, 0.5), y=st.floats(-0.4, 0.4))
def test_distortion_is_that_of_opencv(x: float, y: float) -> None:
    opencv, _ = cv2.projectPoints(
        np.array([[x, y, 1.0]]), np.zeros(3), np.zeros(3), np.eye(3), np.array([DEFAULT.k1, DEFAULT.k2, 0.0, 0.0])
    )
    assert lens.distort(np.array([x, y]), DEFAULT.k1, DEFAULT.k2) == pytest.approx(opencv[0, 0], abs=1e-12)


def test_a_lens_that_folds_over_is_refused() -> None:
    with pytest.raises(ValueError, match="cannot be inverted"):
        lens.undistort(np.array([[0.9, 0.9]]), -0.9, 0.0)


def _poses() -> list[tuple[list[float], list[float]]]:
    """Grids turned this way and that, their normal roughly towards the rig."""
    rng = np.random.default_rng(5)
    return [
        (
            (np.array([0.62, 0.0, 0.20]) + rng.uniform(-0.05, 0.05, 3)).tolist(),
            (np.array([0.0, 0.7, 0.0]) + rng.uniform(-0.35, 0.35, 3)).tolist(),
        )
        for _ in range(5)
    ]


def _corner_offsets(grid: Grid, profile: Profile, pan: float, tilt: float, poses: int) -> NDArray[np.float64]:
    cameras = {name: Camera(name, profile) for name in STEREO}
    measured = []
    for step, (position, euler) in enumerate(_poses()[:poses]):
        corners = grid.pose(position, euler)
        for name, camera in cameras.items():
            expected = rig.project(corners, name, pan, tilt, profile)
            if expected.min() < 15 or (expected > (465, 625)).any():
                continue  # a board that the frame cuts misleads the detector
            drawing = camera.draw(grid.client, rig.camera_from_world(name, pan, tilt))
            found = found_corners(camera.develop(drawing, seed=1, step=step))
            assert len(found) == len(corners), f"the {name} camera does not see the grid at {position}, {euler}"
            measured.append(offsets(found, expected))
    assert len(measured) >= 2 * poses - 2
    off = np.concatenate(measured)
    print(
        f"mean {off.mean(axis=0)}, rms {np.sqrt((off**2).sum(axis=1).mean()):.4f}, largest {np.abs(off).max():.3f} px"
    )
    return off


def test_corners_are_where_projection_says_in_the_ideal_profile(grid: Grid) -> None:
    off = _corner_offsets(grid, IDEAL, *HOME, poses=5)
    assert np.abs(off.mean(axis=0)).max() < 0.02
    assert math.sqrt(float((off**2).sum(axis=1).mean())) < 0.1


def test_corners_are_where_projection_says_through_lens_and_noise(grid: Grid) -> None:
    off = _corner_offsets(grid, DEFAULT, 0.03, HOME[1] - 0.02, poses=3)
    assert np.abs(off.mean(axis=0)).max() < 0.02
    assert math.sqrt(float((off**2).sum(axis=1).mean())) < 0.12


def test_noise_depends_on_seed_camera_and_step_alone(grid: Grid) -> None:
    grid.pose([0.6, 0.0, 0.2], [0.0, 0.7, 0.0])
    left, right = (Camera(name, DEFAULT) for name in STEREO)
    drawing = left.draw(grid.client, rig.left_from_world(*HOME))
    first = left.develop(drawing, seed=1, step=7)
    others = [
        left.develop(drawing, seed=2, step=7),
        left.develop(drawing, seed=1, step=8),
        right.develop(drawing, seed=1, step=7),
    ]
    assert all((other != first).mean() > 0.5 for other in others)
    assert np.array_equal(left.develop(drawing, seed=1, step=7), first)


def test_noise_is_as_strong_as_the_profile_says(grid: Grid) -> None:
    grid.pose([0.6, 0.0, 0.2], [0.0, 0.7, 0.0])
    noisy, clean = Camera("left", replace(IDEAL, pixel_noise=3.0)), Camera("left", IDEAL)
    drawing = clean.draw(grid.client, rig.left_from_world(*HOME))
    still = clean.develop(drawing, seed=1, step=7).astype(np.int16)
    difference = noisy.develop(drawing, seed=1, step=7) - still
    grey = (still > 20) & (still < 235)  # black and white cut the noise off
    assert grey.sum() > 1000
    assert difference[grey].std() == pytest.approx(3.0, rel=0.1)
    assert difference[grey].mean() == pytest.approx(0.0, abs=0.3)


def test_what_is_in_view_is_in_both_pictures() -> None:
    assert rig.in_view([0.6, 0.0, 0.1], 0.0, -0.5)
    for elsewhere in ((0.6, 0.9, 0.1), (0.6, 0.0, 1.4), (3.0, 0.0, 0.1)):
        assert not rig.in_view(elsewhere, 0.0, -0.5)
