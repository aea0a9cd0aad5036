"""Cameras and a head without any simulation, for tests of what stands above them: plain pictures, a clock to turn."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import replace

import numpy as np

from handeye.camera_bridge.driver import Course, Frame, HeadState, StereoPair, Tick
from handeye.camera_bridge.turning import Range, Track, check_course, check_limits
from handeye.rpc.errors import DeadlineExceeded

_TICK = 0.02


class FakeClock:
    """World time that passes only when told."""

    def __init__(self, start: float = 10.0) -> None:
        self._time = start
        self._changed = threading.Condition()

    def __call__(self) -> float:
        """World time in s."""
        with self._changed:
            return self._time

    def advance(self, duration: float) -> None:
        """Lets `duration` s pass."""
        with self._changed:
            self._time += duration
            self._changed.notify_all()

    def wait_until(self, world_time: float, timeout: float, on_tick: Tick | None = None) -> bool:
        """Whether `world_time` comes within `timeout` s of the caller's time."""
        deadline = time.monotonic() + timeout
        while True:
            if on_tick is not None:
                on_tick()
            left = deadline - time.monotonic()
            with self._changed:
                if self._changed.wait_for(lambda: self._time >= world_time, min(_TICK, max(left, 0.0))):
                    return True
            if left <= 0.0:
                return False


class FakeHead:
    """A head without steps that turns at 1 rad/s and lets its clock pass while it turns."""

    limits: tuple[Range, Range] = ((-math.pi, math.pi), (-1.0, 0.5))
    step = 0.0
    speed = 1.0

    def __init__(self, clock: FakeClock) -> None:
        self._clock = clock
        self._track = Track((0.0, 0.0), self.step, self.speed, acceleration=4.0)

    def state(self) -> HeadState:
        """Where the head points now."""
        now = self._clock()
        (pan, tilt), moving = self._track.at(now)
        return HeadState(pan, tilt, moving, now)

    def move(self, pan: float, tilt: float, lease_id: str, timeout: float, on_tick: Tick | None = None) -> HeadState:
        """Turns at once, as far as the caller's time is concerned."""
        check_limits(pan, tilt, *self.limits)
        if on_tick is not None:
            on_tick()
        now = self._clock()
        self._clock.advance(self._track.turn(now, (pan, tilt)).end - now)
        return self.state()

    def follow(self, course: Course, lasting: float, lease_id: str, timeout: float) -> HeadState:
        """Turns on while its clock passes."""
        now = self._clock()
        check_course(course, lasting, now, *self.limits)
        self._track.follow(now, course, lasting, self.limits)
        return self.state()

    def close(self) -> None:
        """Nothing to release."""


class FakeCameras:
    """Cameras whose pictures are grey, brighter with every picture; latency and skew are as told."""

    size = (48, 64)

    def __init__(self, clock: FakeClock, head: FakeHead, latency: float = 0.05, skew: float = 0.004) -> None:
        self._clock = clock
        self._head = head
        self.latency = latency
        self._skew = skew
        self._newest: dict[str, Frame] = {}

    def grab_stereo(self, not_older_than: float, timeout: float, on_tick: Tick | None = None) -> StereoPair:
        """A pair of which neither picture shows a time before `not_older_than` (world time in s)."""
        left = self._expose("stereo", not_older_than, timeout, self._skew, on_tick)
        right = replace(left, world_time=left.world_time + self._skew)
        return StereoPair(left, right, self._skew, replace(self._head.state(), world_time=left.world_time))

    def grab_observer(self, not_older_than: float, timeout: float) -> Frame:
        """A picture from the observer's camera."""
        return self._expose("observer", not_older_than, timeout, 0.0)

    def close(self) -> None:
        """Nothing to release."""

    def _expose(
        self, camera: str, not_older_than: float, timeout: float, skew: float, on_tick: Tick | None = None
    ) -> Frame:
        """The newest picture if it is late enough; the same one again while time stands still."""
        if not self._clock.wait_until(not_older_than + skew + self.latency, timeout, on_tick):
            raise DeadlineExceeded(
                f"no picture of world time {not_older_than:.3f} s or later within {timeout:g} s: the newest shows "
                f"{self._clock() - skew - self.latency:.3f} s"
            )
        exposure = self._clock() - skew - self.latency
        newest = self._newest.get(camera)
        if newest is None or newest.world_time != exposure:
            sequence = 0 if newest is None else newest.sequence + 1
            newest = Frame(np.full((*self.size, 3), sequence % 256, dtype=np.uint8), exposure, sequence)
            self._newest[camera] = newest
        return newest
