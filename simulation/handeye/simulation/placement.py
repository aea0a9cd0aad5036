"""Where objects may be put."""

from __future__ import annotations

import math

import numpy as np
import pybullet
from numpy.typing import NDArray

from handeye.rpc.errors import InvalidArgument
from handeye.simulation import scene
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.scene import Stage

Array = NDArray[np.float64]

_MARGIN = 0.01  # objects stand this far inside the table, m


def require_on_table(spec: ObjectSpec, xy: Array, yaw: float) -> None:
    """`InvalidArgument` when an object at `xy` (2,), m, turned by `yaw`, rad, would not stand on the table whole."""
    for name, values in (("position", xy), ("yaw", yaw)):
        if not np.isfinite(values).all():
            raise InvalidArgument(f"{name} of {spec.name!r} must be finite, got {values}", detail=name)
    margin = spec.radius + _MARGIN
    (x0, x1), (y0, y1) = scene.TABLE_X, scene.TABLE_Y
    if not (x0 + margin <= xy[0] <= x1 - margin and y0 + margin <= xy[1] <= y1 - margin):
        raise InvalidArgument(
            f"{spec.name!r} cannot stand at ({xy[0]:.3f}, {xy[1]:.3f}): the table reaches from ({x0}, {y0}) to"
            f" ({x1}, {y1})",
            detail="position",
        )


def put(stage: Stage, spec: ObjectSpec, xy: Array, yaw: float) -> None:
    """Builds an object standing on the table at `xy` (2,), m, turned by `yaw`, rad.

    Raises:
        InvalidArgument: another object or the robot is there; the stage is as it was.
    """
    body = stage.add(spec)
    orientation = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    position = (float(xy[0]), float(xy[1]), spec.height / 2)
    pybullet.resetBasePositionAndOrientation(body, position, orientation, physicsClientId=stage.client)
    others = {**stage.objects, "robot": stage.robot}
    taken = [
        name
        for name, other in others.items()
        if other != body and pybullet.getClosestPoints(body, other, 0.0, physicsClientId=stage.client)
    ]
    if taken:
        stage.remove(spec.name)
        raise InvalidArgument(
            f"{spec.name!r} cannot stand at ({xy[0]:.3f}, {xy[1]:.3f}): {', '.join(taken)} is there", detail="position"
        )
