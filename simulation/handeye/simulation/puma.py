"""The PUMA 560: published kinematics, masses and limits, and the URDF that is written from them.

Kinematics in standard Denavit-Hartenberg form, masses, centres of mass and inertias from B. Armstrong, O. Khatib and
J. Burdick, "The explicit dynamic model and inertial parameters of the PUMA 560 arm", ICRA 1986, in the frames of
P. I. Corke's model (Robotics Toolbox, `mdl_puma560`; P. Corke and B. Armstrong-Hélouvry, "A search for consensus
among model parameters reported for the PUMA 560 robot", ICRA 1994), which also gives joint limits, gear ratios and the
torque limits. Speed limits are the manufacturer's.

At zero the upper arm is horizontal and the forearm points up; link 1's z axis is vertical.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handeye.simulation import urdf

Array = NDArray[np.float64]

JOINT_NAMES = ("waist", "shoulder", "elbow", "wrist_roll", "wrist_bend", "flange")

# Denavit-Hartenberg: frame i = frame i-1 · Rz(θ) · Tz(d) · Tx(a) · Rx(alpha).
A: Array = np.array([0.0, 0.4318, 0.0203, 0.0, 0.0, 0.0])
D: Array = np.array([0.0, 0.0, 0.15005, 0.4318, 0.0, 0.0])
ALPHA: Array = np.radians([90.0, 0.0, -90.0, 90.0, -90.0, 0.0])

LOWER: Array = np.radians([-160.0, -45.0, -225.0, -110.0, -100.0, -266.0])
UPPER: Array = np.radians([160.0, 225.0, 45.0, 170.0, 100.0, 266.0])
SPEED: Array = np.radians([82.0, 74.0, 122.0, 228.0, 241.0, 228.0])
"""Speed limits in rad/s."""
ACCELERATION: Array = np.array([6.0, 6.0, 9.0, 16.0, 16.0, 16.0])
"""Acceleration limits in rad/s^2: ours, a quarter of a second to full speed, well within the torques."""
TORQUE: Array = np.array([97.6, 186.4, 89.4, 24.2, 20.1, 21.3])
"""Torque limits in N m."""

GEAR_RATIO: Array = np.array([62.6111, 107.815, 53.7063, 76.0364, 71.923, 76.686])
ENCODER_STEP: Array = 2 * np.pi / (1000.0 * GEAR_RATIO)
"""Angle of the joint for one encoder count, in rad: 250 lines a motor turn, counted at each of four edges."""

# Link 1 has no published mass (only its inertia about the waist matters, and it is carried by the base).
MASS: Array = np.array([13.0, 17.4, 4.8, 0.82, 0.34, 0.09])
CENTRE_OF_MASS: Array = np.array(
    [
        [0.0, 0.0, 0.0],
        [-0.3638, 0.006, 0.2275],
        [-0.0203, -0.0141, 0.070],
        [0.0, 0.019, 0.0],
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 0.032],
    ]
)
INERTIA: Array = np.array(
    [
        [0.35, 0.35, 0.35],
        [0.13, 0.524, 0.539],
        [0.066, 0.086, 0.0125],
        [1.8e-3, 1.3e-3, 1.8e-3],
        [0.3e-3, 0.4e-3, 0.3e-3],
        [0.15e-3, 0.15e-3, 0.04e-3],
    ]
)
"""Principal moments in kg m^2 about the centre of mass, axes of the link's own DH frame. Link 3's violate the triangle
inequality and Bullet's loader would set them to zero: the URDF carries the nearest that it takes (`_loadable`), and
the scene sets the published ones after loading."""

BASE_POSITION: Array = np.array([-0.15, 0.15005, 0.50])
"""Where the waist meets the shoulder axis (DH frame 0), in m, world frame; the frame's axes are the world's. The base
stands d3 to the left, so that with the waist at zero the arm's plane is y = 0; this place leaves 12° to every
joint limit and 14° to the wrist's singularity over the whole workspace."""

FLOOR = -0.72
"""Height of the floor, in m, world frame."""

_CREAM = (0.86, 0.84, 0.78)
_DARK = (0.22, 0.23, 0.26)
_STEEL = (0.55, 0.57, 0.60)
_QUARTER = np.pi / 2


def _shapes() -> list[str]:
    """What each moving link looks and feels like, in its URDF frame (DH frame i-1 turned by θ)."""
    cylinder, solid, visual, box = urdf.cylinder, urdf.solid, urdf.visual, urdf.box
    side = (_QUARTER, 0.0, 0.0)
    return [
        # The shoulder: its drum lies along −y, the axis of joint 2.
        visual(cylinder(0.085, 0.20), _CREAM, (0, 0, -0.13))
        + solid(cylinder(0.105, 0.27), _CREAM, (0, -0.055, 0), side)
        + visual(cylinder(0.075, 0.03), _DARK, (0, 0.09, 0), side),
        # The upper arm runs beside the plane of the forearm.
        solid(box((0.56, 0.17, 0.08)), _CREAM, (0.19, 0, 0.235))
        + visual(cylinder(0.105, 0.084), _CREAM, (0, 0, 0.235))
        + visual(cylinder(0.085, 0.084), _CREAM, (0.4318, 0, 0.235))
        + visual(cylinder(0.05, 0.012), _DARK, (0, 0, 0.281))
        + visual(cylinder(0.04, 0.012), _DARK, (0.4318, 0, 0.281)),
        # The forearm runs along +y of this frame.
        visual(cylinder(0.08, 0.09), _DARK, (0, 0, 0.15))
        + solid(box((0.095, 0.42, 0.085)), _CREAM, (0.0203, 0.16, 0.15005)),
        visual(cylinder(0.042, 0.05), _STEEL, (0, 0, 0.395)),
        visual(cylinder(0.040, 0.075), _DARK),
        visual(cylinder(0.032, 0.03), _STEEL, (0, 0, 0.045)),
    ]


def links_and_joints() -> str:
    """URDF of base, links and joints; the last link, `flange`, has DH frame 6.

    With standard DH parameters joint i turns about z of frame i−1, and URDF puts a link's frame on its joint: so the
    frame of URDF link i is DH frame i−1 turned by θ_i, and joint i+1 is offset from it by Tz(d_i) Tx(a_i) Rx(alpha_i).
    """
    column = float(BASE_POSITION[2]) - 0.18 - FLOOR
    parts = [
        urdf.link(
            "base",
            urdf.inertial(50.0, (1.0, 1.0, 1.0)),
            urdf.visual(urdf.cylinder(0.095, column), _DARK, (0, 0, -0.18 - column / 2)),
            urdf.visual(urdf.box((0.36, 0.36, 0.03)), _DARK, (0, 0, -0.18 - column + 0.015)),
        )
    ]
    parent, xyz, rpy = "base", urdf.ZERO, urdf.ZERO
    for i, (name, shapes) in enumerate(zip(JOINT_NAMES, _shapes(), strict=True)):
        tilt = (float(ALPHA[i]), 0.0, 0.0)
        turn = _rotation_x(float(ALPHA[i]))
        centre = np.array([A[i], 0.0, D[i]]) + turn @ CENTRE_OF_MASS[i]
        parts.append(urdf.link(name, urdf.inertial(MASS[i], _loadable(INERTIA[i]), centre, tilt), shapes))
        parts.append(
            f'<joint name="{name}_joint" type="revolute"><parent link="{parent}"/><child link="{name}"/>'
            f'{urdf.origin(xyz, rpy)}<axis xyz="0 0 1"/><limit lower="{LOWER[i]:.12g}" upper="{UPPER[i]:.12g}" '
            f'effort="{TORQUE[i]:.12g}" velocity="{SPEED[i]:.12g}"/></joint>\n'
        )
        parent, xyz, rpy = name, (float(A[i]), 0.0, float(D[i])), tilt
    return "".join(parts)


def _loadable(inertia: Array) -> Array:
    """The principal moments with none greater than the sum of the other two."""
    limited: Array = np.minimum(inertia, inertia.sum() - inertia)
    return limited


def _rotation_x(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
