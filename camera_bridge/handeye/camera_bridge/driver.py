"""What the camera bridge asks of cameras and of the pan/tilt head, simulated, remote or real."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
"""Colour picture, shape (rows, columns, 3), red green blue."""

Tick = Callable[[], None]
"""Called again and again in the caller's thread while a driver waits; what it raises ends the wait and leaves."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One picture: the pixels, the world time in s that they show, and a running number."""

    image: Image
    world_time: float
    sequence: int


@dataclass(frozen=True, slots=True)
class HeadState:
    """Where the head points: pan (positive to its left) and tilt (positive up) in rad."""

    pan: float
    tilt: float
    moving: bool
    world_time: float


@dataclass(frozen=True, slots=True)
class Course:
    """Where a head is to point as time goes: (pan, tilt) in rad at `world_time` in s, and on at rates in rad/s."""

    pan: float
    tilt: float
    pan_rate: float
    tilt_rate: float
    world_time: float

    def at(self, world_time: float) -> tuple[float, float]:
        """(pan, tilt) in rad at a world time in s."""
        elapsed = world_time - self.world_time
        return self.pan + self.pan_rate * elapsed, self.tilt + self.tilt_rate * elapsed


@dataclass(frozen=True, slots=True)
class StereoPair:
    """Left and right picture, right minus left world time in s, and the head when the left was taken."""

    left: Frame
    right: Frame
    skew: float
    head: HeadState


@dataclass(frozen=True, slots=True)
class CameraDescription:
    """Image size in pixels, head range in rad, step in rad, speed in rad/s, latency in s of world time."""

    width: int
    height: int
    pan_range: tuple[float, float]
    tilt_range: tuple[float, float]
    step: float
    speed: float
    latency: float


LONGEST_FOLLOW = 5.0
"""For so long at most a head goes on by itself, in s of world time: who steered it may be gone."""


class CameraDriver(Protocol):
    """Both cameras of the rig, and the observer's."""

    @property
    def size(self) -> tuple[int, int]:
        """Image size as (rows, columns)."""
        ...

    @property
    def latency(self) -> float:
        """A frame can be had this long after what it shows, in s of world time."""
        ...

    def grab_stereo(self, not_older_than: float, timeout: float, on_tick: Tick | None = None) -> StereoPair:
        """A pair of which neither picture shows a time before `not_older_than` (world time in s).

        `DeadlineExceeded` when there is none within `timeout` s of the caller's time; the message says which world
        time is the newest to be had. `on_tick` is called about every 20 ms while it waits for the picture.
        """
        ...

    def grab_observer(self, not_older_than: float, timeout: float) -> Frame:
        """A picture from the observer's camera, for people."""
        ...

    def close(self) -> None:
        """Releases the cameras."""
        ...


class HeadDriver(Protocol):
    """The pan/tilt unit."""

    @property
    def limits(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """((pan lowest, pan highest), (tilt lowest, tilt highest)) in rad."""
        ...

    @property
    def step(self) -> float:
        """Smallest step of both axes in rad; 0 for none."""
        ...

    @property
    def speed(self) -> float:
        """Greatest speed of both axes in rad/s."""
        ...

    def state(self) -> HeadState:
        """Where the head points now."""
        ...

    def move(self, pan: float, tilt: float, lease_id: str, timeout: float, on_tick: Tick | None = None) -> HeadState:
        """Turns to (pan, tilt) in rad, rounded to the unit's steps; returns when it stands still.

        `OutOfLimits` outside the range, `Unauthorised` unless `lease_id` is the control lease. `on_tick` is called
        about every 20 ms while it turns; when a move ends early the head stands still where it is then.
        """
        ...

    def follow(self, course: Course, lasting: float, lease_id: str, timeout: float) -> HeadState:
        """Begins to turn so that it comes to point where `course` says, and returns at once with where it points now.

        It keeps within its speed, acceleration and range. After `lasting` s of world time (0..`LONGEST_FOLLOW`) it
        slows down and stands still, unless another call comes before: 0 makes it stand still. `OutOfLimits` when the
        course is out of range now, `InvalidArgument` for what are no such numbers, `Unauthorised` unless `lease_id` is
        the control lease, `Busy` during a move. `Stopped` while the robot is stopped: the head stands still too then.
        """
        ...

    def close(self) -> None:
        """Releases the head."""
        ...
