"""The hand: a parallel gripper with two fingers, and a marker plate that identifies it to the cameras.

Tool frame: origin between the finger pads, z = approach direction, y = direction of finger travel (finger 1 at +y).
With joints 4 and 6 at zero x points down, so the plate stands at −x, above the palm.
"""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from handeye.simulation import urdf

Array = NDArray[np.float64]

TOOL_LENGTH = 0.19
"""From the wrist's centre (DH frame 6) to the tool centre point along z, in m."""
RANGE = 0.090
"""Greatest distance between the pads, in m."""
FINGER_TRAVEL = RANGE / 2
"""Travel of each finger, in m: its joint position is its pad's distance from the middle."""
FORCE = 15.0
"""Gripping force of each finger, in N."""
SPEED = 0.08
"""Speed of each finger, in m/s."""
PAD_FRICTION = 0.8
"""Friction coefficient of the pads; Bullet multiplies it with the object's."""
TIP = 0.014
"""The fingers reach this far beyond the tool centre point, in m."""
FINGER_WIDTH = 0.022
"""Width of a finger across approach and travel, in m."""

MARKER_DICTIONARY = cv2.aruco.DICT_4X4_50
MARKER_ID = 7
MARKER_SIDE = 0.060
"""Edge of the marker's black square, in m."""
MARKER_CELL = MARKER_SIDE / 6
PLATE_SIDE = 8 * MARKER_CELL
"""Edge of the plate: the marker with a white margin of one cell, in m."""

_PALM_DEPTH, _PALM_FACE = 0.05, -0.075
_FINGER_THICKNESS = 0.012
_FINGER_MASS = 0.06
_PLATE_ELEVATION = math.radians(50.0)
_PLATE_TURN = math.radians(22.5)
_PLATE_CENTRE = (-0.074, 0.0, -0.100)
_DARK, _STEEL, _RUBBER = (0.20, 0.21, 0.23), (0.42, 0.44, 0.47), (0.12, 0.12, 0.12)
_WHITE, _BLACK = (1.0, 1.0, 1.0), (0.02, 0.02, 0.02)


def _plate_pose() -> Array:
    """tool_from_marker: x to the marker's right as it is read, y up, z out of the plate towards its reader.

    The normal leans from the approach direction upwards (−x) by more than the tool is pitched down, so that it
    points at the rig, which looks down at the workspace from the front. It is turned in its own plane, so that the
    marker's edges cross the pixels' rows and columns: along them, every pixel of an edge would tell the same
    (docs/decisions/024).
    """
    c, s = math.cos(_PLATE_ELEVATION), math.sin(_PLATE_ELEVATION)
    normal, level = np.array([-s, 0.0, c]), np.array([0.0, 1.0, 0.0])
    right = math.cos(_PLATE_TURN) * level + math.sin(_PLATE_TURN) * np.cross(normal, level)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = right, np.cross(normal, right), normal
    pose[:3, 3] = _PLATE_CENTRE
    return pose


TOOL_FROM_MARKER: Array = _plate_pose()
"""Pose of the marker's centre in the tool frame, 4×4, in m."""


def marker_place(world_from_tool: Array) -> Array:
    """Where the middle of the marker is, (3,) in m, world frame."""
    place: Array = (world_from_tool @ TOOL_FROM_MARKER)[:3, 3]
    return place


def marker_cells() -> NDArray[np.bool_]:
    """The plate's 8×8 cells, True where black: the marker with its white margin."""
    dictionary = cv2.aruco.getPredefinedDictionary(MARKER_DICTIONARY)
    return np.pad(cv2.aruco.generateImageMarker(dictionary, MARKER_ID, 6) == 0, 1)


def links_and_joints(parent: str, folder: Path) -> str:
    """URDF of hand and fingers on the link `parent` (DH frame 6); meshes are written into `folder`."""
    parts = [
        urdf.link(
            "hand",
            urdf.inertial(0.35, (4e-4, 2e-4, 4e-4), (0, 0, -0.10)),
            urdf.visual(urdf.cylinder(0.022, 0.07), _DARK, (0, 0, -0.14)),
            urdf.solid(urdf.box((0.05, 0.125, _PALM_DEPTH)), _STEEL, (0, 0, _PALM_FACE - _PALM_DEPTH / 2)),
            *_plate(folder),
        ),
        f'<joint name="hand_joint" type="fixed"><parent link="{parent}"/><child link="hand"/>'
        f"{urdf.origin((0, 0, TOOL_LENGTH))}</joint>\n",
    ]
    length = TIP - _PALM_FACE
    for name, side in (("finger_1", 1.0), ("finger_2", -1.0)):
        finger = urdf.box((FINGER_WIDTH, _FINGER_THICKNESS, length))
        pad = urdf.box((FINGER_WIDTH - 0.002, 0.0025, 0.05))
        parts += [
            urdf.link(
                name,
                urdf.inertial(_FINGER_MASS, (5e-5, 5e-5, 5e-6)),
                urdf.solid(finger, _DARK, (0, side * _FINGER_THICKNESS / 2, TIP - length / 2)),
                urdf.visual(pad, _RUBBER, (0, side * 0.0010, TIP - 0.026)),
            ),
            f'<joint name="{name}_joint" type="prismatic"><parent link="hand"/><child link="{name}"/>'
            f'{urdf.origin()}<axis xyz="0 {side:.0f} 0"/><limit lower="0" upper="{FINGER_TRAVEL}" '
            f'effort="{4 * FORCE}" velocity="{2 * SPEED}"/></joint>\n',
        ]
    return "".join(parts)


def _plate(folder: Path) -> list[str]:
    """The plate: a thin backing, one mesh of its white cells and one of its black cells, edges exact."""
    rpy = _rpy(TOOL_FROM_MARKER[:3, :3])
    normal = TOOL_FROM_MARKER[:3, 2]
    centre = TOOL_FROM_MARKER[:3, 3]
    black = marker_cells()
    white_mesh = urdf.write_cells(folder / "marker_white.obj", ~black, MARKER_CELL)
    black_mesh = urdf.write_cells(folder / "marker_black.obj", black, MARKER_CELL)
    post = urdf.box((0.055, 0.012, 0.008))
    return [
        urdf.visual(urdf.mesh(white_mesh), _WHITE, centre, rpy),
        urdf.visual(urdf.mesh(black_mesh), _BLACK, centre, rpy),
        urdf.solid(urdf.box((PLATE_SIDE, PLATE_SIDE, 0.002)), _DARK, centre - 0.0025 * normal, rpy),
        urdf.visual(post, _DARK, (-0.045, 0, -0.112)),
    ]


def _rpy(rotation: Array) -> tuple[float, float, float]:
    """Roll, pitch and yaw of URDF (Rz·Ry·Rx), in rad."""
    return (
        math.atan2(rotation[2, 1], rotation[2, 2]),
        math.atan2(-rotation[2, 0], math.hypot(rotation[2, 1], rotation[2, 2])),
        math.atan2(rotation[1, 0], rotation[0, 0]),
    )
