"""The bodies of objects and of the pictures that they are learned from."""

from __future__ import annotations

from pydantic import Field

from handeye.server.schemas.base import LATEST, Body, Number


class Grab(Body):
    """Which pictures will do."""

    not_older_than: Number = Field(default=0.0, ge=0.0, le=LATEST)
    """Oldest world time that the pictures may show, in s; 0: the newest there are."""


class ObjectInfo(Body):
    """An object: how many stereo pairs without and with it are known, and whether it can be recognised."""

    name: str
    backgrounds: int
    examples: int
    learned: bool


class ObjectList(Body):
    """The objects, in the order of their first pictures."""

    objects: tuple[ObjectInfo, ...]
