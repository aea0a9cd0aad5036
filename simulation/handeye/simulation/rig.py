"""The geometry of the stereo rig and of the observer's camera, from `rig.toml`.

For rendering, and for tests, teaching and scoring. The acting side learns what is here; it never reads it.

Frames: a camera's optical frame has x to the right, y down, z along the optical axis; the head frame has x forward, y
to its left, z up, its origin where the pan and tilt axes cross. Angles in rad, lengths in m, pixels as (row, column).
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handeye.simulation import lens
from handeye.simulation.profile import Profile

CameraName = Literal["left", "right", "observer"]
CAMERAS: tuple[CameraName, ...] = get_args(CameraName)
MARGIN = 30.0
"""What is in view is so many px from the pictures' borders."""

Matrix = NDArray[np.float64]
"""Homogeneous transform, shape (4, 4)."""

_OPTICAL_FROM_HEAD_AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Rows: the optical frame's x (right), y (down) and z (forward) in a frame with x forward, y left, z up."""


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """Pinhole camera: image size, focal length and principal point in pixels."""

    width: int
    height: int
    focal_length: float
    principal_row: float
    principal_column: float


@dataclass(frozen=True, slots=True)
class Head:
    """The pan/tilt unit: where its axes cross, heading at pan 0, ranges, home, speed and acceleration of both axes."""

    position: tuple[float, float, float]
    heading: float
    home: tuple[float, float]
    pan_range: tuple[float, float]
    tilt_range: tuple[float, float]
    speed: float
    acceleration: float


@dataclass(frozen=True, slots=True)
class Rig:
    """All that `rig.toml` says, in rad and m."""

    camera: Intrinsics
    observer: Intrinsics
    baseline: float
    bar_forward: float
    bar_up: float
    head: Head
    observer_position: tuple[float, float, float]
    observer_looks_at: tuple[float, float, float]


@cache
def rig() -> Rig:
    """The rig of `rig.toml`."""
    data = tomllib.loads(resources.files("handeye.simulation").joinpath("rig.toml").read_text(encoding="utf-8"))
    camera, bar, head, observer = data["camera"], data["bar"], data["head"], data["observer"]
    row, column = camera["principal_point"]
    return Rig(
        camera=Intrinsics(camera["width"], camera["height"], camera["focal_length"], row, column),
        observer=Intrinsics(camera["width"], camera["height"], observer["focal_length"], row, column),
        baseline=bar["baseline"],
        bar_forward=bar["forward"],
        bar_up=bar["up"],
        head=Head(
            position=_three(head["position"]),
            heading=math.radians(head["heading"]),
            home=_radians(head["home"]),
            pan_range=_radians(head["pan_range"]),
            tilt_range=_radians(head["tilt_range"]),
            speed=math.radians(head["speed"]),
            acceleration=math.radians(head["acceleration"]),
        ),
        observer_position=_three(observer["position"]),
        observer_looks_at=_three(observer["looks_at"]),
    )


def intrinsics(camera: CameraName) -> Intrinsics:
    """The intrinsics of a camera."""
    return rig().observer if camera == "observer" else rig().camera


def head_from_world(pan: float, tilt: float) -> Matrix:
    """(4, 4) transform from world to the head frame at (pan, tilt) in rad."""
    head = rig().head
    heading = head.heading + pan
    # Positive tilt looks up: a rotation about the head's own y axis (to its left) by -tilt.
    rotation = _about_z(heading) @ _about_y(-tilt)
    return _inverse(rotation, np.array(head.position))


def left_from_world(pan: float, tilt: float) -> Matrix:
    """(4, 4) transform from world to the left camera's optical frame, head at (pan, tilt) in rad."""
    return camera_from_world("left", pan, tilt)


def camera_from_world(camera: CameraName, pan: float, tilt: float) -> Matrix:
    """(4, 4) transform from world to the optical frame of a camera; the observer's does not turn with the head."""
    if camera == "observer":
        return _observer_from_world()
    the_rig = rig()
    # In the head frame y is to the left.
    sideways = the_rig.baseline / 2 if camera == "left" else -the_rig.baseline / 2
    camera_from_head = np.eye(4)
    camera_from_head[:3, :3] = _OPTICAL_FROM_HEAD_AXES
    camera_from_head[:3, 3] = -_OPTICAL_FROM_HEAD_AXES @ np.array([the_rig.bar_forward, sideways, the_rig.bar_up])
    result: Matrix = camera_from_head @ head_from_world(pan, tilt)
    return result


def project(
    points_world: ArrayLike, camera: CameraName, pan: float, tilt: float, profile: Profile
) -> NDArray[np.float64]:
    """Where points show in a camera's picture, with the lens distortion of `profile`.

    `points_world`: (..., 3) in m. Returns (..., 2) as (row, column) in pixels, which may lie outside the image; NaN for
    points that are not in front of the camera.
    """
    points = np.asarray(points_world, dtype=np.float64)
    camera_from = camera_from_world(camera, pan, tilt)
    in_camera = points @ camera_from[:3, :3].T + camera_from[:3, 3]
    depth = np.where(in_camera[..., 2:] > 0, in_camera[..., 2:], np.nan)
    distorted = lens.distort(in_camera[..., :2] / depth, profile.k1, profile.k2)
    optics = intrinsics(camera)
    row = optics.principal_row + optics.focal_length * distorted[..., 1]
    column = optics.principal_column + optics.focal_length * distorted[..., 0]
    return np.stack([row, column], axis=-1)


def in_view(place: ArrayLike, pan: float, tilt: float, margin: float = MARGIN) -> bool:
    """Whether a point (3,), m, world frame, is in both pictures, `margin` px from their borders."""
    camera = rig().camera
    for name in CAMERAS[:2]:
        row, column = project(place, name, pan, tilt, Profile.named("ideal"))
        # Not true of nan: what lies behind a camera.
        if not (margin < row < camera.height - margin and margin < column < camera.width - margin):
            return False
    return True


def _observer_from_world() -> Matrix:
    position = np.array(rig().observer_position)
    forward = np.array(rig().observer_looks_at) - position
    forward /= np.linalg.norm(forward)
    left = np.cross([0.0, 0.0, 1.0], forward)
    left /= np.linalg.norm(left)
    axes = np.column_stack([forward, left, np.cross(forward, left)])
    camera_from_axes = np.eye(4)
    camera_from_axes[:3, :3] = _OPTICAL_FROM_HEAD_AXES
    result: Matrix = camera_from_axes @ _inverse(axes, position)
    return result


def _inverse(rotation: NDArray[np.float64], position: NDArray[np.float64]) -> Matrix:
    """frame_from_world of a frame whose axes are the columns of `rotation` and whose origin is `position`."""
    result = np.eye(4)
    result[:3, :3] = rotation.T
    result[:3, 3] = -rotation.T @ position
    return result


def _about_z(angle: float) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _about_y(angle: float) -> NDArray[np.float64]:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _radians(pair: list[float]) -> tuple[float, float]:
    first, second = pair
    return math.radians(first), math.radians(second)


def _three(values: list[float]) -> tuple[float, float, float]:
    x, y, z = values
    return float(x), float(y), float(z)
