"""The datasets are what their descriptions say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from handeye.experiments import datasets
from handeye.experiments.datasets import DATASETS, StereoRig

BOARD = datasets.shared_folder() / "data" / "stereo-chessboard"
needs_board = pytest.mark.skipif(not BOARD.is_dir(), reason=f"{BOARD} is absent; HANDEYE_SHARED names its folder")


@pytest.mark.parametrize("name", [pytest.param(n, marks=needs_board if "real" in n else ()) for n in DATASETS])
def test_problems_are_drawn_from_the_seed(name: str) -> None:
    first, again, other = (DATASETS[name].draw(seed) for seed in (1, 1, 2))
    for ours, theirs in zip(first, again, strict=True):
        assert np.array_equal(ours, theirs)
        assert np.all(np.isfinite(ours))
    assert not np.array_equal(first.inputs, other.inputs)
    assert len(first.inputs) == len(first.outputs)
    assert len(first.test_inputs) == len(first.test_outputs)
    trained = {row.tobytes() for row in first.inputs}
    assert not trained & {row.tobytes() for row in first.test_inputs}, "a training sample is also a test"


def test_the_rigs_axes_meet_at_the_worlds_origin() -> None:
    rig = StereoRig()
    pixels, seen = rig.project(np.array([[0, 0, rig.height]]))
    assert pixels[0] == pytest.approx([239.5, 319.5, 0], abs=1e-9)
    assert seen.all()


def test_the_rigs_cameras_mirror_each_other() -> None:
    point, mirrored = np.array([[0.03, 0.02, 0.7]]), np.array([[-0.03, 0.02, 0.7]])
    (_, left, disparity), (_, mirrored_left, _) = (StereoRig().project(each)[0][0] for each in (point, mirrored))
    assert left - disparity == pytest.approx(639 - mirrored_left)


def test_disparity_tells_depth() -> None:
    rig = StereoRig()
    pixels, _ = rig.project(np.array([[0, 0, rig.height], [0, 0, rig.height + 0.001]]))
    # f b / h^2 for parallel cameras; these are turned by 6.5 degrees.
    assert pixels[1, 2] - pixels[0, 2] == pytest.approx(0.001 * 1923 * 0.170 / rig.height**2, rel=0.03)


def test_points_outside_an_image_are_not_seen() -> None:
    points = np.array([[0.2, 0, 0.744], [0, 0.2, 0.744], [0, 0, -0.744], [0.05, 0.05, 0.744]])
    assert StereoRig().project(points)[1].tolist() == [False, False, False, True]


def test_noise_is_the_rounding_of_pixels() -> None:
    perfect, noisy = (datasets.simulated_stereo(3, noisy=noisy) for noisy in (False, True))
    assert np.array_equal(noisy.inputs, np.round(perfect.inputs))
    assert np.array_equal(noisy.test_inputs, np.round(perfect.test_inputs))
    assert np.array_equal(noisy.outputs, perfect.outputs)


@needs_board
def test_new_views_are_boards_never_shown() -> None:
    problem = datasets.chessboard(5, new_views=True)
    assert (len(problem.inputs), len(problem.test_inputs)) == (22 * 54, 7 * 54)
    nearest = [np.linalg.norm(problem.outputs - point, axis=1).min() for point in problem.test_outputs[::54]]
    assert min(nearest) > 1e-4


@needs_board
def test_new_points_are_as_many_as_the_thesiss() -> None:
    problem = datasets.chessboard(5, new_views=False)
    assert (problem.inputs.shape, problem.test_inputs.shape) == ((365, 3), (200, 3))
    assert 0.2 < problem.outputs[:, 2].min() < problem.outputs[:, 2].max() < 0.6


def test_an_absent_board_is_said_to_be(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HANDEYE_SHARED", str(tmp_path))
    with pytest.raises(FileNotFoundError, match=r"corners\.csv is missing; HANDEYE_SHARED names the folder"):
        datasets.chessboard(1, new_views=False)


def test_appendix_d_is_tested_on_a_grid() -> None:
    problem = datasets.appendix_d_surface(1, function=datasets.sine, low=-2, high=2)
    assert problem.inputs.shape == (200, 2)
    assert problem.test_inputs.shape == (41 * 41, 2)
    assert np.abs(problem.test_inputs).max() == 2
    assert np.diff(problem.test_inputs[:41, 0]) == pytest.approx(0.1)
    assert datasets.sine(np.array([[0.25, 0.0]])) == pytest.approx(1)
    assert datasets.paraboloid(np.array([[2.0, -1.0]])) == pytest.approx(6.3)


def test_friedmans_function_ignores_thirty_inputs() -> None:
    problem = datasets.friedman(1)
    x = problem.inputs.T
    truth = 10 * np.sin(np.pi * x[0] * x[1]) + 20 * (x[2] - 0.5) ** 2 + 10 * x[3] + 5 * x[4]
    assert problem.inputs.shape == (1000, 35)
    assert problem.outputs[:, 0] == pytest.approx(truth)


def test_the_arms_maps_are_inverse_to_each_other() -> None:
    forward, inverse = (datasets.planar_arm(1, inverse=inverse) for inverse in (False, True))
    for ours, theirs in zip(inverse, (forward.outputs, forward.inputs, *forward[:1:-1]), strict=True):
        assert np.array_equal(ours, theirs)
    elbow = forward.inputs[:, 1]
    reach = np.sqrt(0.4**2 + 0.3**2 + 2 * 0.4 * 0.3 * np.cos(elbow))
    assert np.linalg.norm(forward.outputs, axis=1) == pytest.approx(reach)
