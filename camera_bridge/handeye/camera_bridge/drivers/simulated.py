"""Cameras and head of the simulated lab: pictures of a mirror of the world, and a head that turns with world time."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager

from handeye.camera_bridge.driver import Course, Frame, HeadState, StereoPair, Tick
from handeye.camera_bridge.turning import Range, Track, check_course, check_limits
from handeye.proto.methods import ROBOT_ADVANCE
from handeye.proto.v1 import robot_pb2
from handeye.rpc import Bus, LabBusSettings
from handeye.rpc.errors import Busy, DeadlineExceeded, InvalidArgument, Stopped, Unauthorised, Unavailable
from handeye.simulation import rig
from handeye.simulation.lab import LabClient
from handeye.simulation.mirror import Mirror
from handeye.simulation.profile import Profile
from handeye.simulation.scene import STEP

_POLL = 0.005
"""Seconds between two looks at the world's clock."""

_PATIENCE = 1.0
"""Seconds for one try to reach the lab; between two tries a process may be told to stop."""


@contextmanager
def connect(
    settings: LabBusSettings, bus: Bus, timeout: float, stop: threading.Event
) -> Iterator[tuple[SimulatedCameras, SimulatedHead]]:
    """Cameras and head of the lab at `settings`, for which it waits up to `timeout` s or until `stop` is set.

    `bus` is the acting one. `Unavailable` when nobody serves the lab by then.
    """
    with _open_lab(settings, time.monotonic() + timeout, stop) as lab_bus:
        lab = LabClient(lab_bus)
        with closing(SimulatedHead(lab, bus)) as head, closing(SimulatedCameras(lab, head)) as cameras:
            yield cameras, head


def _open_lab(settings: LabBusSettings, deadline: float, stop: threading.Event) -> Bus:
    """The lab bus as soon as the lab is served there."""
    refused = False
    while True:
        try:
            lab_bus = Bus.open(settings, name="camera-bridge", timeout=_PATIENCE)
            try:
                lab_bus.wait_for("Lab", _PATIENCE)
            except BaseException:
                lab_bus.close()
                raise
        except Unauthorised:
            # A lab that begins to listen just when a try has ended looks like this, once.
            if refused:
                raise
            refused = True
        except Unavailable:
            refused = False
            if stop.is_set() or time.monotonic() >= deadline:
                raise
        else:
            return lab_bus


class SimulatedCameras:
    """The stereo pair and the observer's camera. A picture shows a physics step and can be had `latency` later."""

    def __init__(self, lab: LabClient, head: SimulatedHead) -> None:
        self._head = head
        self._profile = Profile.named(lab.scene().profile)
        self._latency = _steps(self._profile.latency)
        self._skew = round(self._profile.skew / STEP)
        home = head.state()
        self._mirror = Mirror(lab)
        self._mirror.prepare(home.pan, home.tilt)
        self._lock = threading.Lock()
        self._newest: dict[rig.CameraName, Frame] = {}

    @property
    def size(self) -> tuple[int, int]:
        """Image size as (rows, columns)."""
        optics = rig.intrinsics("left")
        return optics.height, optics.width

    @property
    def latency(self) -> float:
        """A frame can be had this long after what it shows, in s of world time."""
        return self._profile.latency

    def grab_stereo(self, not_older_than: float, timeout: float, on_tick: Tick | None = None) -> StereoPair:
        """A pair of which neither picture shows a time before `not_older_than` (world time in s).

        The right picture is taken the profile's skew after the left one, to the nearest physics step. Right after a
        reset, when no picture could be had yet, both show the world at time 0: so it has stood until then.
        """
        deadline = time.monotonic() + timeout
        right = self._wait(not_older_than, self._skew, deadline, on_tick)
        left = max(0, right - self._skew)
        with self._turn(deadline):
            head = self._head.at(left * STEP)
            frames = self._picture("left", left), self._picture("right", right)
        return StereoPair(*frames, skew=frames[1].world_time - frames[0].world_time, head=head)

    def grab_observer(self, not_older_than: float, timeout: float) -> Frame:
        """A picture from the observer's camera, for people."""
        deadline = time.monotonic() + timeout
        step = self._wait(not_older_than, 0, deadline)
        with self._turn(deadline):
            return self._picture("observer", step)

    def close(self) -> None:
        """Lets go of the mirror."""
        self._mirror.close()

    def _wait(self, not_older_than: float, earlier: int, deadline: float, on_tick: Tick | None = None) -> int:
        """The step of the newest exposure to be had, once the one `earlier` steps before it is late enough too."""
        while True:
            if on_tick is not None:
                on_tick()
            now = self._head.now()
            newest = max(0, math.floor(now / STEP + 1e-6) - self._latency)
            if not_older_than <= 0.0 or newest - earlier >= _steps(not_older_than):
                return newest
            if time.monotonic() >= deadline:
                raise DeadlineExceeded(
                    f"no picture shows world time {not_older_than:.3f} s or later: it is {now:.3f} s now, and the "
                    f"newest picture to be had shows {max(0, newest - earlier) * STEP:.3f} s; let world time pass first"
                )
            time.sleep(_POLL)

    @contextmanager
    def _turn(self, deadline: float) -> Iterator[None]:
        """One caller at a time has its pictures rendered."""
        if not self._lock.acquire(timeout=max(0.0, deadline - time.monotonic())):
            raise DeadlineExceeded("the cameras were busy with other callers' pictures until the time was out")
        try:
            yield
        finally:
            self._lock.release()

    def _picture(self, camera: rig.CameraName, step: int) -> Frame:
        """The picture of a step; the same frame again when nothing has changed since the last one."""
        head = self._head.at(step * STEP)
        image, world_time = self._mirror.picture(camera, step * STEP, head.pan, head.tilt)
        newest = self._newest.get(camera)
        if newest is None or newest.image is not image:
            newest = Frame(image, world_time, 0 if newest is None else newest.sequence + 1)
            self._newest[camera] = newest
        return newest


class SimulatedHead:
    """The pan/tilt unit of `rig.toml` as a function of world time. A reset of the world sends it home."""

    def __init__(self, lab: LabClient, bus: Bus) -> None:
        """`bus`: the acting bus, on which the robot bridge lets world time pass."""
        self._lab = lab
        self._bus = bus
        self._unit = rig.rig().head
        self._lock = threading.Lock()
        self._turning = threading.Lock()
        self._step = Profile.named(lab.scene().profile).head_step
        self._track = Track(self._unit.home, self._step, self._unit.speed, self._unit.acceleration)
        self._mark: tuple[float, int] | None = None

    @property
    def limits(self) -> tuple[Range, Range]:
        """((pan lowest, pan highest), (tilt lowest, tilt highest)) in rad."""
        return self._unit.pan_range, self._unit.tilt_range

    @property
    def step(self) -> float:
        """Smallest step of both axes in rad; 0 for none."""
        return self._step

    @property
    def speed(self) -> float:
        """Greatest speed of both axes in rad/s."""
        return self._unit.speed

    def state(self) -> HeadState:
        """Where the head points now."""
        return self.at(self.now())

    def at(self, world_time: float) -> HeadState:
        """Where the head pointed at a world time since the last reset."""
        with self._lock:
            (pan, tilt), moving = self._track.at(world_time)
        return HeadState(pan, tilt, moving, world_time)

    def now(self) -> float:
        """World time in s; the head is home if the world was reset since the last look."""
        with self._lock:
            now = self._lab.world().world_time
            if self._was_reset(now):
                self._track.clear()
            self._mark = None
            if self._track.turned and now >= STEP:
                # The step before the newest one: of the newest, a placement may still change the version.
                self._mark = (now, self._lab.world(now - STEP).scene_version)
            return now

    def move(self, pan: float, tilt: float, lease_id: str, timeout: float, on_tick: Tick | None = None) -> HeadState:
        """Turns to (pan, tilt) in rad, rounded to the unit's steps; returns when it stands still.

        `OutOfLimits` outside the range, `Busy` while it turns for somebody else. The robot bridge lets world time pass
        under `lease_id`: lease, heartbeats and software stop are its to check, and its errors end the move. When a
        move ends early the head stands still where it is then.
        """
        check_limits(pan, tilt, *self.limits)
        deadline = time.monotonic() + timeout
        if not self._turning.acquire(blocking=False):
            raise Busy("the head is turning already; wait until it stands still")
        try:
            self._advance(0.0, lease_id, deadline, on_tick)  # refused before anything turns, if it is to be refused
            now = self.now()
            with self._lock:
                end = self._track.turn(now, (pan, tilt)).end
            try:
                self._advance(end - now, lease_id, deadline, on_tick)
            except BaseException:
                self._halt()
                raise
            return self.state()
        finally:
            self._turning.release()

    def follow(self, course: Course, lasting: float, lease_id: str, timeout: float) -> HeadState:
        """Begins to turn so that it comes to point where `course` says, for `lasting` s; returns at once.

        The robot bridge checks the lease, and refuses while the robot is stopped: then the head stands still too.
        """
        deadline = time.monotonic() + timeout
        if not self._turning.acquire(blocking=False):
            raise Busy("the head is turning already; wait until it stands still")
        try:
            try:
                self._advance(0.0, lease_id, deadline, None)
            except Stopped:
                self._halt()
                raise
            now = self.now()
            check_course(course, lasting, now, *self.limits)
            with self._lock:
                self._track.follow(now, course, lasting, self.limits)
            return self.at(now)
        finally:
            self._turning.release()

    def close(self) -> None:
        """Nothing to release: the buses stay their owner's to close."""

    def _was_reset(self, now: float) -> bool:
        """Whether what was the world's past at the last look is not its past any more."""
        if self._mark is None:
            return False
        marked, version = self._mark
        if now < marked:
            return True
        try:
            return self._lab.world(marked - STEP).scene_version != version
        except InvalidArgument:  # longer ago than the world remembers
            return False

    def _advance(self, duration: float, lease_id: str, deadline: float, on_tick: Tick | None) -> None:
        """Waits at the robot bridge until `duration` s of world time, rounded up to its steps, have passed."""
        request = robot_pb2.AdvanceRequest(lease_id=lease_id, duration=_steps(duration) * STEP)
        self._bus.call(ROBOT_ADVANCE, request, timeout=deadline - time.monotonic(), on_tick=on_tick)

    def _halt(self) -> None:
        """Stands still from now on."""
        now = self.now()
        with self._lock:
            self._track.halt(now)


def _steps(duration: float) -> int:
    """Physics steps that cover a duration in s."""
    return math.ceil(duration / STEP - 1e-6)
