"""Where objects may be put."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pybullet
from numpy.typing import NDArray

from handeye.rpc.errors import InvalidArgument
from handeye.simulation import objects, scene
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.pose import Pose
from handeye.simulation.scene import Stage

Array = NDArray[np.float64]

_MARGIN = 0.01  # objects stand this far inside the table, m
_TOUCH = 1e-4  # what overlaps by less touches: an object that stands on the table is not in it, m
_UNIT = 1e-6  # how far from 1 the length of a unit quaternion may be


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


def standing(spec: ObjectSpec, xy: Array, yaw: float) -> Pose:
    """The pose of an object standing on the table at `xy` (2,), m, turned by `yaw`, rad."""
    return Pose(np.array([xy[0], xy[1], spec.height / 2]), np.array([0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)]))


def checked(spec: ObjectSpec, pose: Pose) -> Pose:
    """`pose` with its quaternion normalised; `InvalidArgument` when it is no pose in the lab to hold an object at."""
    for name, values, size in (("position", pose.position, 3), ("orientation", pose.orientation, 4)):
        if values.shape != (size,) or not np.isfinite(values).all():
            raise InvalidArgument(f"{name} of {spec.name!r} must be {size} finite numbers, got {values}", detail=name)
    if np.abs(pose.position).max() > scene.ROOM:
        raise InvalidArgument(
            f"{spec.name!r} cannot be held at {_numbers(pose.position)}: the lab reaches {scene.ROOM:g} m from the"
            " world's origin",
            detail="position",
        )
    length = math.hypot(*pose.orientation)
    if abs(length - 1.0) > _UNIT:
        raise InvalidArgument(
            f"orientation of {spec.name!r} must be a unit quaternion (x, y, z, w), got one of length {length:.9g}",
            detail="orientation",
        )
    return Pose(pose.position, pose.orientation / length)


def put(stage: Stage, spec: ObjectSpec, pose: Pose, *, fixed: bool = False) -> None:
    """Builds an object at `pose`, in place of one of the same name; nothing moves it when it is `fixed`.

    Raises:
        InvalidArgument: another object, the robot, the table or the floor is there; the stage is as it was.
    """
    body = objects.build(stage.client, spec, fixed=fixed)
    pybullet.resetBasePositionAndOrientation(
        body, pose.position.tolist(), pose.orientation.tolist(), physicsClientId=stage.client
    )
    if taken := _taken(stage, spec.name, body):
        pybullet.removeBody(body, physicsClientId=stage.client)
        raise InvalidArgument(
            f"{spec.name!r} cannot be at {_numbers(pose.position)}: {', '.join(taken)} is there", detail="position"
        )
    if spec.name in stage.objects:
        stage.remove(spec.name)
    stage.objects[spec.name] = body


def require_free(stage: Stage, name: str, poses: Sequence[Pose]) -> None:
    """`InvalidArgument` unless object `name` can be at every one of `poses`; afterwards it is where it was."""
    body = stage.objects[name]
    before = pybullet.getBasePositionAndOrientation(body, physicsClientId=stage.client)
    try:
        for pose in poses:
            pybullet.resetBasePositionAndOrientation(
                body, pose.position.tolist(), pose.orientation.tolist(), physicsClientId=stage.client
            )
            if taken := _taken(stage, name, body):
                raise InvalidArgument(
                    f"{name!r} cannot be pushed over {_numbers(pose.position)}: {', '.join(taken)} is there",
                    detail="path",
                )
    finally:
        pybullet.resetBasePositionAndOrientation(body, *before, physicsClientId=stage.client)


def _taken(stage: Stage, name: str, body: int) -> list[str]:
    """What is where `body` is, to be object `name`."""
    others = [(other, there) for other, there in stage.objects.items() if other != name]
    others += [("the robot", stage.robot), ("the table", stage.table), ("the floor", stage.floor)]
    return [
        other
        for other, there in others
        if pybullet.getClosestPoints(body, there, -_TOUCH, physicsClientId=stage.client)
    ]


def _numbers(position: Array) -> str:
    return f"({', '.join(f'{value:.4g}' for value in position)})"
