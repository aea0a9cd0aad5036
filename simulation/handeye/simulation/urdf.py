"""Pieces of URDF text and OBJ meshes, from which the robot and the objects are written."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Vector = Sequence[float] | NDArray[np.float64]
Color = tuple[float, float, float]

ZERO = (0.0, 0.0, 0.0)


def _numbers(values: Vector) -> str:
    return " ".join(repr(float(value)) for value in values)


def origin(xyz: Vector = ZERO, rpy: Vector = ZERO) -> str:
    """An `<origin>`: xyz in m, rpy in rad."""
    return f'<origin xyz="{_numbers(xyz)}" rpy="{_numbers(rpy)}"/>'


def box(size: Vector) -> str:
    """A box with edges `size` in m, centred."""
    return f'<geometry><box size="{_numbers(size)}"/></geometry>'


def cylinder(radius: float, length: float) -> str:
    """A cylinder about z, centred; m."""
    return f'<geometry><cylinder radius="{radius:.12g}" length="{length:.12g}"/></geometry>'


def sphere(radius: float) -> str:
    """A sphere, centred; m."""
    return f'<geometry><sphere radius="{radius:.12g}"/></geometry>'


def mesh(path: Path) -> str:
    """The mesh in an OBJ file."""
    return f'<geometry><mesh filename="{path}"/></geometry>'


def visual(geometry: str, color: Color, xyz: Vector = ZERO, rpy: Vector = ZERO) -> str:
    """A `<visual>` in one plain colour (red, green, blue in 0..1)."""
    red, green, blue = color
    # Materials are global in a URDF: the name is the colour, so that equal names mean equal colours.
    name = f"rgb_{red:.4f}_{green:.4f}_{blue:.4f}"
    material = f'<material name="{name}"><color rgba="{_numbers(color)} 1"/></material>'
    return f"<visual>{origin(xyz, rpy)}{geometry}{material}</visual>"


def collision(geometry: str, xyz: Vector = ZERO, rpy: Vector = ZERO) -> str:
    """A `<collision>` shape."""
    return f"<collision>{origin(xyz, rpy)}{geometry}</collision>"


def solid(geometry: str, color: Color, xyz: Vector = ZERO, rpy: Vector = ZERO) -> str:
    """A shape that is both seen and felt."""
    return visual(geometry, color, xyz, rpy) + collision(geometry, xyz, rpy)


def inertial(mass: float, inertia: Vector, xyz: Vector = ZERO, rpy: Vector = ZERO) -> str:
    """An `<inertial>`: mass in kg, principal moments in kg m^2 about the centre of mass at xyz (m)."""
    xx, yy, zz = inertia
    return (
        f'<inertial>{origin(xyz, rpy)}<mass value="{mass:.12g}"/>'
        f'<inertia ixx="{xx:.12g}" iyy="{yy:.12g}" izz="{zz:.12g}" ixy="0" ixz="0" iyz="0"/></inertial>'
    )


def link(name: str, *parts: str) -> str:
    """A `<link>`."""
    return f'<link name="{name}">{"".join(parts)}</link>\n'


def robot(name: str, *parts: str) -> str:
    """A whole URDF document."""
    return f'<?xml version="1.0"?>\n<robot name="{name}">\n{"".join(parts)}</robot>\n'


def write_quads(path: Path, quads: NDArray[np.float64], normals: NDArray[np.float64]) -> Path:
    """Writes an OBJ of quads (n,4,3), counter-clockwise seen from outside, with corner normals (n,4,3)."""
    lines = [f"v {_numbers(v)}" for v in quads.reshape(-1, 3)]
    lines += [f"vn {_numbers(v)}" for v in normals.reshape(-1, 3)]
    for first in range(1, 4 * len(quads), 4):
        a, b, c, d = (f"{index}//{index}" for index in range(first, first + 4))
        lines += [f"f {a} {b} {c}", f"f {a} {c} {d}"]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_cells(path: Path, cells: NDArray[np.bool_], size: float) -> Path:
    """Writes the True cells of a grid as squares of edge `size` (m) in the plane z = 0, facing +z.

    Row 0 is at +y, column 0 at −x, as a picture is read; the grid's centre is the origin.
    """
    rows, columns = cells.shape
    row, column = np.nonzero(cells)
    left = (column - columns / 2) * size
    top = (rows / 2 - row) * size
    quads = np.zeros((len(row), 4, 3))
    quads[:, :, 0] = left[:, None] + size * np.array([0, 1, 1, 0])
    quads[:, :, 1] = top[:, None] - size * np.array([1, 1, 0, 0])
    normals = np.zeros_like(quads)
    normals[:, :, 2] = 1.0
    return write_quads(path, quads, normals)


def write_lathe(path: Path, outline: NDArray[np.float64], segments: int = 64) -> Path:
    """Writes the solid of revolution of an outline.

    Args:
        path: the OBJ file to write.
        outline: (n,2) points (radius, z) in m, walked so that the outside lies to the right.
        segments: flat pieces around; the shading is smooth around and sharp at the outline's corners.
    """
    turn = np.arange(segments + 1) * (2 * math.pi / segments)
    around = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    quads, normals = [], []
    for (r0, z0), (r1, z1) in pairwise(outline):
        slope = np.array([z1 - z0, r0 - r1]) / math.hypot(r1 - r0, z1 - z0)
        for here, there in pairwise(around):
            quads.append([[*(r0 * here), z0], [*(r0 * there), z0], [*(r1 * there), z1], [*(r1 * here), z1]])
            out_here, out_there = [*(slope[0] * here), slope[1]], [*(slope[0] * there), slope[1]]
            normals.append([out_here, out_there, out_there, out_here])
    return write_quads(path, np.array(quads), np.array(normals))
