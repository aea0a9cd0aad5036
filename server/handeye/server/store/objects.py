"""Objects in the store: their pictures, as PNG files."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from sqlalchemy import Connection, delete, func, select

from handeye.camera_bridge.driver import Image
from handeye.server.pictures import png
from handeye.server.store.rows import add, find, now
from handeye.server.store.tables import object_pictures, objects


def names(connection: Connection) -> tuple[str, ...]:
    """In the order of their first pictures."""
    return tuple(connection.execute(select(objects.c.name).order_by(objects.c.created, objects.c.name)).scalars())


def counts(connection: Connection, name: str) -> dict[str, int]:
    """How many pairs of each kind an object has."""
    kind = object_pictures.c.kind
    wanted = select(kind, func.count()).where(object_pictures.c.object == name).group_by(kind)
    return {row[0]: row[1] for row in connection.execute(wanted)}


def pairs(connection: Connection, name: str) -> Iterator[tuple[str, Image, Image]]:
    """(kind, left, right) in the order they were taken."""
    wanted = select(object_pictures).where(object_pictures.c.object == name).order_by(object_pictures.c.number)
    for row in connection.execute(wanted).mappings():
        yield row["kind"], _decoded(row["left_image"]), _decoded(row["right_image"])


def add_pair(connection: Connection, name: str, kind: str, left: Image, right: Image) -> None:
    """Adds a pair of pictures, and the object when these are its first ones."""
    if find(connection, objects, name) is None:
        add(connection, objects, name=name, created=now())
    newest = select(func.max(object_pictures.c.number)).where(object_pictures.c.object == name)
    number = 1 + (connection.execute(newest).scalar() or 0)
    images: dict[str, Any] = {"left_image": png(left), "right_image": png(right)}
    add(connection, object_pictures, object=name, number=number, kind=kind, **images)


def drop(connection: Connection, name: str) -> bool:
    """Deletes an object with its pictures; False when there is none."""
    return bool(connection.execute(delete(objects).where(objects.c.name == name)).rowcount)


def _decoded(content: bytes) -> Image:
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError("a stored picture is no PNG file; look at the store with `handeye verify`")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
