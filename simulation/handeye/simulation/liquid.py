"""Liquid as particles: spheres that are filled into a cup and run where it is tilted.

A particle has no orientation that anybody could see: its place is all that is told of it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pybullet
from numpy.typing import NDArray

from handeye.rpc.errors import InvalidArgument
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.pose import Pose

Array = NDArray[np.float64]

RADIUS = 0.006
"""Of a particle, in m."""
MASS = 1000.0 * 4.0 / 3.0 * math.pi * RADIUS**3
"""Of a particle of water, in kg."""
PARTICLES = 40
"""So many are 36 ml of spheres; they fill a quarter of a cup."""

_COLOR = (0.35, 0.65, 0.90)
_FRICTION = 0.05
_ROLLING_FRICTION = 1e-5  # m: what has run off comes to rest
_PITCH = 2.05 * RADIUS  # between particles, before they have settled
_SCATTER = 0.02 * RADIUS  # lest they stand in columns
_GAP = 1.1 * RADIUS  # from the middle of a particle to bottom and wall


def places(spec: ObjectSpec, pose: Pose, count: int, random: np.random.Generator) -> Array:
    """Where `count` particles are to be for a start, (count, 3) in m, world frame: in layers above a cup's bottom.

    `InvalidArgument` when the object holds nothing, is not upright, or is too small for so many.
    """
    if not spec.hollow:
        raise InvalidArgument(f"{spec.name!r} is a {spec.shape}, and holds no liquid", detail="name")
    matrix = pose.matrix()
    if matrix[2, 2] < 0.99:
        raise InvalidArgument(f"{spec.name!r} does not stand upright", detail="name")
    room = spec.inner_radius - _GAP
    steps = _PITCH * np.arange(-math.ceil(room / _PITCH), math.ceil(room / _PITCH) + 1)
    x, y = (each.ravel() for each in np.meshgrid(steps, steps))
    layer = np.column_stack([x, y])[np.hypot(x, y) <= room]
    layers = math.floor((spec.height - spec.wall - 2 * _GAP) / _PITCH) + 1
    if count > layers * len(layer):
        raise InvalidArgument(
            f"{spec.name!r} has room for {layers * len(layer)} particles, not for {count}", detail="particles"
        )
    bottom = spec.wall - spec.height / 2 + _GAP
    found = [(*middle, bottom + _PITCH * level) for level in range(layers) for middle in layer.tolist()]
    inside = np.array(list(itertools.islice(found, count))).reshape(-1, 3)
    inside[:, :2] += random.uniform(-_SCATTER, _SCATTER, (count, 2))
    result: Array = inside @ matrix[:3, :3].T + pose.position
    return result


def build(client: int, where: Array) -> list[int]:
    """Adds particles at (n, 3) to the PyBullet client `client`; returns their body ids."""
    if not len(where):
        return []
    felt = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=RADIUS, physicsClientId=client)
    shown = pybullet.createVisualShape(
        pybullet.GEOM_SPHERE, radius=RADIUS, rgbaColor=[*_COLOR, 1.0], physicsClientId=client
    )
    bodies: list[int] = []
    for place in where.tolist():
        body = pybullet.createMultiBody(MASS, felt, shown, place, physicsClientId=client)
        pybullet.changeDynamics(
            body,
            -1,
            lateralFriction=_FRICTION,
            spinningFriction=0.0,
            rollingFriction=_ROLLING_FRICTION,
            restitution=0.0,
            activationState=pybullet.ACTIVATION_STATE_ENABLE_SLEEPING,
            physicsClientId=client,
        )
        bodies.append(body)
    return bodies


def read(client: int, bodies: Sequence[int]) -> Array:
    """Where particles are, (n, 3) in m, world frame."""
    found = [pybullet.getBasePositionAndOrientation(body, physicsClientId=client)[0] for body in bodies]
    return np.array(found, dtype=np.float64).reshape(-1, 3)


def apply(client: int, bodies: Sequence[int], where: Array) -> None:
    """Puts particles at (n, 3)."""
    for body, place in zip(bodies, where.tolist(), strict=True):
        pybullet.resetBasePositionAndOrientation(body, place, (0.0, 0.0, 0.0, 1.0), physicsClientId=client)


def inside(where: Array, spec: ObjectSpec, pose: Pose) -> NDArray[np.bool_]:
    """Which of the particles at (n, 3) are within an object that holds liquid, (n,): between bottom and rim."""
    own = (where - pose.position) @ pose.matrix()[:3, :3]
    within: NDArray[np.bool_] = (np.hypot(own[:, 0], own[:, 1]) < spec.radius) & (np.abs(own[:, 2]) <= spec.height / 2)
    return within
