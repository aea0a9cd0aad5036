"""The objects of the lab: what they are, a catalogue of them, and how they are built into PyBullet.

World and mirror build them with the same code, so they look the same in both. An object's body frame has its origin at
the centre of its shape, z along its axis; a mug's handle is at +x.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import pybullet
from numpy.typing import NDArray

from handeye.simulation import urdf

Shape = Literal["cup", "tumbler", "mug", "grid", "ball"]

FRICTION = 0.6
"""Friction coefficient of every object; with the pads' 0.8 the product is 0.48."""
SPINNING_FRICTION = 0.001
GRID_INTERSECTIONS = 9
"""The grid target's inner corners along each side."""

_WALLS = 16
_FOOT = 0.002  # the walls' distance from the table, m
_MARGIN = 0.001  # Bullet's collision margin, m
_TAPER = math.radians(6.0)
_GRID_SQUARES = GRID_INTERSECTIONS + 1
_GRID_MARGIN = 0.4  # white margin around the squares, as a share of a square
_GRID_LIFT = 0.0005  # the squares lie so far above the board, lest it shows through, m
_SOLID = ("grid", "ball")  # shapes without a wall
_BALL_SEGMENTS = 32  # from pole to pole


@dataclass(frozen=True, slots=True)
class ObjectSpec:
    """An object that can stand on the table, or be held in the air.

    Attributes:
        name: unique in the world.
        shape: "cup" (straight wall), "tumbler" (wider at the top), "mug" (with a handle), "grid" (flat
            chessboard target, 9×9 intersections), "ball".
        radius: outer radius at half height, in m (grid: half of its width).
        height: in m (grid: its thickness; ball: 2 · radius).
        wall: wall thickness, in m (grid and ball are solid: it does not count).
        mass: in kg.
        color: (red, green, blue), each 0..1 (a grid is black and white).
    """

    name: str
    shape: Shape
    radius: float = 0.0325
    height: float = 0.095
    wall: float = 0.004
    mass: float = 0.12
    color: urdf.Color = (0.10, 0.25, 0.75)

    def __post_init__(self) -> None:
        if self.shape not in get_args(Shape):
            raise ValueError(f"unknown shape {self.shape!r}; known are {', '.join(get_args(Shape))}")
        sizes = {"radius": self.radius, "height": self.height, "mass": self.mass}
        wrong = [name for name, value in sizes.items() if not (math.isfinite(value) and value > 0)]
        if wrong:
            raise ValueError(f"{', '.join(wrong)} of object {self.name!r} must be positive")
        if self.shape == "ball" and not math.isclose(self.height, 2 * self.radius):
            raise ValueError(
                f"height of ball {self.name!r} must be twice its radius, {2 * self.radius:g} m, got {self.height:g} m"
            )
        if self.shape not in _SOLID and not 2 * _MARGIN < self.wall < self.radius / 2:
            raise ValueError(f"wall of object {self.name!r} must be over 2 mm and under half of its radius")
        if len(self.color) != 3 or not all(0 <= channel <= 1 for channel in self.color):
            raise ValueError(f"color of object {self.name!r} must be three numbers in 0..1, got {self.color}")

    @property
    def hollow(self) -> bool:
        """It can hold liquid."""
        return self.shape not in _SOLID

    @property
    def inner_radius(self) -> float:
        """Of what is hollow: the radius inside at the bottom, where it is narrowest, in m."""
        lean = math.tan(_TAPER) * self.height / 2 if self.shape == "tumbler" else 0.0
        return self.radius - lean - self.wall

    def named(self, name: str) -> ObjectSpec:
        """The same object under another name."""
        return replace(self, name=name)


CUPS: dict[str, ObjectSpec] = {
    spec.name: spec
    for spec in (
        ObjectSpec("blue cup", "cup", color=(0.08, 0.22, 0.78)),
        ObjectSpec("yellow cup", "cup", radius=0.030, height=0.085, mass=0.10, color=(0.92, 0.76, 0.08)),
        ObjectSpec("red tumbler", "tumbler", radius=0.0315, height=0.105, mass=0.12, color=(0.80, 0.10, 0.10)),
        ObjectSpec("purple tumbler", "tumbler", radius=0.029, height=0.090, mass=0.10, color=(0.45, 0.12, 0.60)),
        ObjectSpec("green mug", "mug", radius=0.0335, height=0.090, mass=0.16, color=(0.10, 0.55, 0.20)),
        ObjectSpec("orange mug", "mug", radius=0.0325, height=0.095, mass=0.14, color=(0.92, 0.42, 0.06)),
    )
}
"""Cups by name."""

JAR = ObjectSpec("green jar", "cup", radius=0.050, height=0.090, mass=0.35, color=(0.05, 0.50, 0.22))
"""What is poured into: too wide for the hand to grasp."""

STAND = ObjectSpec("red stand", "cup", radius=0.055, height=0.050, wall=0.027, mass=0.60, color=(0.78, 0.12, 0.10))
"""What a cup is put on: a ring with a hole that is smaller than a cup."""

CATALOGUE: dict[str, ObjectSpec] = CUPS | {spec.name: spec for spec in (JAR, STAND)}
"""What can be put on the table, by name."""

GRID = ObjectSpec("grid", "grid", radius=0.27, height=0.006, wall=0.0, mass=1.0, color=(1.0, 1.0, 1.0))
"""The thesis's grid target (3, Fig 4.16): 9×9 intersections 5 cm apart, 40×40 cm between the outermost."""

BALL = ObjectSpec("ball", "ball", radius=0.015, height=0.03, wall=0.0, mass=0.02, color=(0.85, 0.15, 0.55))
"""A ball to be held in the air: a point in space that looks the same from everywhere."""


def grid_pitch(spec: ObjectSpec) -> float:
    """Distance between neighbouring intersections of a grid, in m."""
    return 2 * spec.radius / (_GRID_SQUARES + 2 * _GRID_MARGIN)


def grid_points(spec: ObjectSpec) -> NDArray[np.float64]:
    """The intersections of a grid as they are drawn, (81, 3) in m, in its body frame, on its upper face.

    Row by row as a picture is read, seen from above with +y up: the first has the least x and the greatest y, the
    second follows it in x.
    """
    steps = grid_pitch(spec) * (np.arange(GRID_INTERSECTIONS) - (GRID_INTERSECTIONS - 1) / 2)
    y, x = np.meshgrid(-steps, steps, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, _grid_top(spec))])


def build(client: int, spec: ObjectSpec, *, fixed: bool = False) -> int:
    """Adds an object to the PyBullet client `client`, at the world's origin; returns its body id.

    What is `fixed` collides, but neither gravity nor contact moves it.
    """
    with tempfile.TemporaryDirectory(prefix="handeye-object-") as folder:
        path = Path(folder) / "object.urdf"
        path.write_text(urdf.robot("object", _link(spec, Path(folder))))
        body: int = pybullet.loadURDF(
            str(path), useFixedBase=fixed, flags=pybullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client
        )
    pybullet.changeDynamics(
        body,
        -1,
        lateralFriction=FRICTION,
        spinningFriction=SPINNING_FRICTION,
        rollingFriction=0.0,
        restitution=0.0,
        linearDamping=0.0,
        angularDamping=0.0,
        # A cup at rest falls asleep: awake, the contact solver lets it creep some micrometres a second.
        activationState=pybullet.ACTIVATION_STATE_ENABLE_SLEEPING,
        physicsClientId=client,
    )
    return body


def _link(spec: ObjectSpec, folder: Path) -> str:
    if spec.shape == "grid":
        return urdf.link("object", *_grid(spec, folder))
    if spec.shape == "ball":
        return urdf.link("object", *_ball(spec, folder))
    taper = _TAPER if spec.shape == "tumbler" else 0.0
    parts = [_inertial(spec), *_walls(spec, taper), _bottom(spec, taper), _lathe(spec, taper, folder)]
    if spec.shape == "mug":
        parts += _handle(spec)
    return urdf.link("object", *parts)


def _inertial(spec: ObjectSpec) -> str:
    """A thin-walled tube's inertia; the centre of mass is taken at the centre of the shape."""
    across = spec.mass * (spec.radius**2 / 2 + spec.height**2 / 12)
    return urdf.inertial(spec.mass, (across, across, spec.mass * spec.radius**2))


def _walls(spec: ObjectSpec, taper: float) -> list[str]:
    """Boxes around the axis, their outer faces' middle on the outer radius.

    They end a little above the foot: the object stands on its bottom, with four contacts instead of sixty-four.
    """
    widening = math.tan(taper) * spec.height / 2
    width = 2 * (spec.radius + widening) * math.tan(math.pi / _WALLS)
    height = spec.height - _FOOT
    wall = urdf.box((spec.wall, width, height / math.cos(taper) - spec.wall * math.tan(taper)))
    middle = spec.radius + math.tan(taper) * _FOOT / 2 - spec.wall / 2 / math.cos(taper)
    return [
        urdf.collision(wall, (middle * math.cos(turn), middle * math.sin(turn), _FOOT / 2), (0.0, taper, turn))
        for turn in np.arange(_WALLS) * (2 * math.pi / _WALLS)
    ]


def _bottom(spec: ObjectSpec, taper: float) -> str:
    radius = spec.radius - math.tan(taper) * spec.height / 2 - spec.wall / 2
    # Bullet adds its margin around a cylinder (but not around a box).
    disc = urdf.cylinder(radius - _MARGIN, spec.wall - 2 * _MARGIN)
    return urdf.collision(disc, (0.0, 0.0, (spec.wall - spec.height) / 2))


def _lathe(spec: ObjectSpec, taper: float, folder: Path) -> str:
    half, lean = spec.height / 2, math.tan(taper) * spec.height / 2
    top, foot = spec.radius + lean, spec.radius - lean
    outline: NDArray[np.float64] = np.array(
        [
            [0.0, -half],
            [foot, -half],
            [top, half],
            [top - spec.wall, half],
            [foot - spec.wall, spec.wall - half],
            [0.0, spec.wall - half],
        ]
    )
    return urdf.visual(urdf.mesh(urdf.write_lathe(folder / "body.obj", outline)), spec.color)


def _handle(spec: ObjectSpec) -> list[str]:
    """Three bars at +x."""
    reach, thick, span = 0.028, 0.008, 0.55 * spec.height
    # The bars start inside the wall, so that no gap shows.
    bar = (reach + spec.wall / 2, thick, thick)
    x = spec.radius + (reach - spec.wall / 2) / 2
    return [
        urdf.solid(urdf.box(bar), spec.color, (x, 0, span / 2)),
        urdf.solid(urdf.box(bar), spec.color, (x, 0, -span / 2)),
        urdf.solid(urdf.box((thick, thick, span + thick)), spec.color, (spec.radius + reach, 0, 0)),
    ]


def _ball(spec: ObjectSpec, folder: Path) -> list[str]:
    """A solid ball: felt as a true sphere, seen as a turned one."""
    turn = np.linspace(0.0, math.pi, _BALL_SEGMENTS + 1)
    outline = spec.radius * np.column_stack([np.sin(turn), -np.cos(turn)])
    return [
        urdf.inertial(spec.mass, (0.4 * spec.mass * spec.radius**2,) * 3),
        urdf.collision(urdf.sphere(spec.radius)),
        urdf.visual(urdf.mesh(urdf.write_lathe(folder / "ball.obj", outline)), spec.color),
    ]


def _grid_top(spec: ObjectSpec) -> float:
    """Height of a grid's squares in its body frame, in m."""
    return spec.height / 2 + _GRID_LIFT


def _grid(spec: ObjectSpec, folder: Path) -> list[str]:
    """A white board with black squares; a square has its corners on the intersections."""
    black = np.indices((_GRID_SQUARES, _GRID_SQUARES)).sum(axis=0) % 2 == 0
    pitch = grid_pitch(spec)
    top = (0.0, 0.0, _grid_top(spec))
    board = (2 * spec.radius, 2 * spec.radius, spec.height)
    across = spec.mass * (2 * spec.radius) ** 2 / 12
    white_mesh = urdf.write_cells(folder / "white.obj", ~black, pitch)
    black_mesh = urdf.write_cells(folder / "black.obj", black, pitch)
    return [
        urdf.inertial(spec.mass, (across, across, 2 * across)),
        urdf.solid(urdf.box(board), spec.color),
        urdf.visual(urdf.mesh(white_mesh), spec.color, top),
        urdf.visual(urdf.mesh(black_mesh), (0.02, 0.02, 0.02), top),
    ]
