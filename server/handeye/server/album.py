"""The pictures of a job's looks: each becomes durable together with the event that tells of it."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

from sqlalchemy import Connection

from handeye.server.store import jobs as stored


@dataclass(frozen=True, slots=True)
class Picture:
    """One of them, as a JPEG file. `number` counts from 0 within its job."""

    number: int
    image: bytes
    job: str
    kept: int

    @property
    def path(self) -> str:
        """Where it can be had by HTTP."""
        return f"/v1/jobs/{self.job}/looks/{self.number}.jpg"

    def keep(self, connection: Connection) -> None:
        """Writes it down."""
        stored.add_picture(connection, self.job, self.number, self.image, self.kept)


class Album:
    """Numbers them."""

    def __init__(self, job: str, kept: int) -> None:
        """`job`: its id; the newest `kept` jobs with pictures keep theirs."""
        self._job = job
        self._kept = kept
        self._numbers = itertools.count()

    def picture(self, image: bytes) -> Picture:
        """The next one; it is not kept yet."""
        return Picture(next(self._numbers), image, self._job, self._kept)
