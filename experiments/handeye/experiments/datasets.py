"""The maps that the comparison learns, as training and test samples drawn from a seed.

Seeds 1 and 2 were used to choose the baselines' settings; report figures of others. For the real chessboard a seed only
splits the one recorded set anew: its settings have seen most of those corners.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.datasets import make_friedman1

Floats = NDArray[np.float64]

STEREO_SAMPLES = 800
"""The largest of the thesis's networks (4.1.3)."""
STEREO_SPREAD = 0.050
"""m, standard deviation of the points around the world's origin; the thesis does not give its own."""
BOARD_SAMPLES, BOARD_TESTS, BOARD_VIEWS = 365, 200, 22
"""Training and test points, as many as on the thesis's own rig (4.2.3), and views when whole views are held back."""
APPENDIX_D_SAMPLES, APPENDIX_D_GRID = 200, 0.1
FRIEDMAN_SAMPLES, FRIEDMAN_INPUTS = 1000, 35
ARM_SAMPLES = 500
UPPER_ARM, FOREARM = 0.4, 0.3
"""m, links of the two-joint arm."""
TESTS = 1000
"""Test samples where nothing else is said."""


class Problem(NamedTuple):
    """A map to learn: n training and q test samples with d inputs and p outputs, in m, rad and px."""

    inputs: Floats
    """(n, d)"""
    outputs: Floats
    """(n, p)"""
    test_inputs: Floats
    """(q, d)"""
    test_outputs: Floats
    """(q, p)"""


class Dataset(NamedTuple):
    """Where problems are drawn from."""

    draw: Callable[[int], Problem]
    """From a seed; raises FileNotFoundError where recorded data is absent."""
    unit: str
    """Of the reported errors; empty for pure numbers."""
    scale: float
    """Reported error = scale x error in the outputs' own unit."""
    recorded: bool = False
    """Whether a seed only splits one recorded set anew."""


# --- Thesis 4.1: stereo in simulation --------------------------------------------------------------------------------


class StereoRig(NamedTuple):
    """The simulated rig of thesis 4.1.1. Its frame lies halfway between the cameras, z along the view."""

    baseline: float = 0.170
    """m between the cameras, along x"""
    height: float = 0.744
    """m from the frame's origin to the point on z where the optical axes meet: the world's origin"""
    focal_row: float = 1587.0
    """px, f_v"""
    focal_column: float = -1923.0
    """px, f_u; negative: columns grow towards -x"""
    rows: int = 480
    columns: int = 640

    def project(self, points: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Of points (n, 3) [m]: left row, left column, disparity [px] (n, 3), and whether both cameras see them (n,).

        The epipolar constraint is assumed as in the thesis: the right row is not an input.
        """
        angle = np.arctan2(self.baseline / 2, self.height)
        left, seen_by_left = self._image(points, -self.baseline / 2, angle)
        right, seen_by_right = self._image(points, self.baseline / 2, -angle)
        return np.column_stack([left, left[:, 1] - right[:, 1]]), seen_by_left & seen_by_right

    def _image(self, points: Floats, place: float, angle: float) -> tuple[Floats, NDArray[np.bool_]]:
        """Rows and columns (n, 2) in the camera at x = place, which is turned about y by angle [rad]."""
        x, y, z = points[:, 0] - place, points[:, 1], points[:, 2]
        sideways, depth = x * np.cos(angle) - z * np.sin(angle), x * np.sin(angle) + z * np.cos(angle)
        last = np.array([self.rows, self.columns]) - 1.0
        pixels = last / 2 + np.column_stack([self.focal_row * y / depth, self.focal_column * sideways / depth])
        return pixels, (depth > 0) & np.all((pixels >= 0) & (pixels <= last), axis=1)


def simulated_stereo(seed: int, *, noisy: bool) -> Problem:
    """Left row, left column, disparity -> (x, y, z) in the rig's frame, as for Fig 4.4.

    Points are Gaussian around the world's origin and visible to both cameras. noisy rounds the pixels of training and
    test samples to integers.
    """
    rig, rng = StereoRig(), np.random.default_rng(seed)
    # About 95 in 100 are visible.
    drawn = rng.normal([0, 0, rig.height], STEREO_SPREAD, size=(2 * (STEREO_SAMPLES + TESTS), 3))
    pixels, seen = rig.project(drawn)
    inputs = np.round(pixels[seen]) if noisy else pixels[seen]
    return _split(inputs, drawn[seen], STEREO_SAMPLES, TESTS)


# --- A real pair of webcams ------------------------------------------------------------------------------------------


def shared_folder() -> Path:
    """Where recorded data lies: HANDEYE_SHARED, or the folder `shared` beside the repository."""
    return Path(os.environ.get("HANDEYE_SHARED") or Path(__file__).resolve().parents[4] / "shared")


class Corners(NamedTuple):
    """All chessboard corners that two real webcams saw."""

    inputs: Floats
    """(n, 3) left row, left column, disparity [px]"""
    outputs: Floats
    """(n, 3) (x, y, z) in the left camera's frame [m]"""
    views: NDArray[np.int64]
    """(n,) which picture of the board each comes from"""


def corners() -> Corners:
    """Reads the recorded set.

    Raises:
        FileNotFoundError: it is not there.
    """
    path = shared_folder() / "data" / "stereo-chessboard" / "corners.csv"
    if not path.is_file():
        raise FileNotFoundError(f"{path} is missing; HANDEYE_SHARED names the folder that holds data/stereo-chessboard")
    table = np.genfromtxt(path, delimiter=",", names=True)
    pixels = [table["left_row"], table["left_col"], table["left_col"] - table["right_col"]]
    places = np.column_stack([table["x_m"], table["y_m"], table["z_m"]])
    return Corners(np.column_stack(pixels), places, table["view"].astype(np.int64))


def chessboard(seed: int, *, new_views: bool) -> Problem:
    """Left row, left column, disparity -> (x, y, z) of chessboard corners that two real webcams saw.

    365 training points and 200 others; or all points of 22 views, tested with those of the other views.

    Raises:
        FileNotFoundError: the set is not there.
    """
    inputs, outputs, views = corners()
    rng = np.random.default_rng(seed)
    if new_views:
        trained = np.isin(views, rng.permutation(np.unique(views))[:BOARD_VIEWS])
        return Problem(inputs[trained], outputs[trained], inputs[~trained], outputs[~trained])
    order = rng.permutation(len(inputs))
    return _split(inputs[order], outputs[order], BOARD_SAMPLES, BOARD_TESTS)


# --- Functions -------------------------------------------------------------------------------------------------------


def paraboloid(inputs: Floats) -> Floats:
    """x^2 + 2.3 y^2 of inputs (n, 2); shape (n, 1) (Appendix D)."""
    return np.asarray(inputs[:, :1] ** 2 + 2.3 * inputs[:, 1:] ** 2)


def sine(inputs: Floats) -> Floats:
    """sin[(2 x + y) pi] of inputs (n, 2); shape (n, 1) (Appendix D)."""
    return np.asarray(np.sin((2 * inputs[:, :1] + inputs[:, 1:]) * np.pi))


def appendix_d_surface(seed: int, *, function: Callable[[Floats], Floats], low: float, high: float) -> Problem:
    """200 uniform samples of a function of low <= x, y <= high; the tests are a grid of 0.1 (Appendix D)."""
    inputs = np.random.default_rng(seed).uniform(low, high, (APPENDIX_D_SAMPLES, 2))
    ticks = np.linspace(low, high, round((high - low) / APPENDIX_D_GRID) + 1)
    grid = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    return Problem(inputs, function(inputs), grid, function(grid))


def friedman(seed: int) -> Problem:
    """Friedman's function of 5 inputs among 30 that mean nothing, all uniform in [0, 1]; without output noise.

    10 sin(pi x1 x2) + 20 (x3 - 1/2)^2 + 10 x4 + 5 x5: J. H. Friedman, "Multivariate adaptive regression splines",
    Annals of Statistics 19 (1991) 1-67.
    """
    inputs, outputs = make_friedman1(FRIEDMAN_SAMPLES + TESTS, n_features=FRIEDMAN_INPUTS, random_state=seed)
    return _split(inputs, outputs[:, np.newaxis], FRIEDMAN_SAMPLES, TESTS)


def planar_arm(seed: int, *, inverse: bool) -> Problem:
    """Joint angles [rad] of a planar arm with two joints -> its hand's (x, y) [m]; or the inverse, elbow on one side.

    Angles are uniform; the elbow stays 0.2 rad away from straight and folded.
    """
    rng = np.random.default_rng(seed)
    joints = rng.uniform([-np.pi / 2, 0.2], [np.pi / 2, np.pi - 0.2], (ARM_SAMPLES + TESTS, 2))
    shoulder, wrist = joints[:, 0], joints.sum(axis=1)
    hand = np.column_stack(
        [
            UPPER_ARM * np.cos(shoulder) + FOREARM * np.cos(wrist),
            UPPER_ARM * np.sin(shoulder) + FOREARM * np.sin(wrist),
        ]
    )
    inputs, outputs = (hand, joints) if inverse else (joints, hand)
    return _split(inputs, outputs, ARM_SAMPLES, TESTS)


def _split(inputs: Floats, outputs: Floats, train: int, test: int) -> Problem:
    """The first samples for training, those after them for the test."""
    end = train + test
    return Problem(inputs[:train], outputs[:train], inputs[train:end], outputs[train:end])


def _surface(function: Callable[[Floats], Floats], reach: float) -> Callable[[int], Problem]:
    chosen: dict[str, Any] = {"function": function, "low": -reach, "high": reach}
    return partial(appendix_d_surface, **chosen)


DATASETS: dict[str, Dataset] = {
    "stereo in simulation, perfect (Fig 4.4)": Dataset(partial(simulated_stereo, noisy=False), "mm", 1e3),
    "stereo in simulation, noisy (Fig 4.4)": Dataset(partial(simulated_stereo, noisy=True), "mm", 1e3),
    "real stereo, new points": Dataset(partial(chessboard, new_views=False), "mm", 1e3, recorded=True),
    "real stereo, new views": Dataset(partial(chessboard, new_views=True), "mm", 1e3, recorded=True),
    "x² + 2.3 y² on ±1 (Appendix D)": Dataset(_surface(paraboloid, 1), "", 1),
    "sin[(2x + y)π] on ±1 (Appendix D)": Dataset(_surface(sine, 1), "", 1),
    "sin[(2x + y)π] on ±2 (Appendix D)": Dataset(_surface(sine, 2), "", 1),
    "Friedman, 30 noise inputs": Dataset(friedman, "", 1),
    "two-joint arm, forward": Dataset(partial(planar_arm, inverse=False), "mm", 1e3),
    "two-joint arm, inverse": Dataset(partial(planar_arm, inverse=True), "mrad", 1e3),
}
"""By the name that the table gives them."""
