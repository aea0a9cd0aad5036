"""Control of robot and head by people and programs over REST, under a lease that ends with its holder.

The coordinator holds the bridge's control lease for them and sends its heartbeats; they show every two seconds that
they are still there. When they don't, a motion under way is braked and control is free again.
"""

from __future__ import annotations

import hmac
import secrets
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass, field
from typing import Protocol

import structlog

from handeye.camera_bridge.driver import HeadDriver, HeadState
from handeye.robot_bridge.driver import RobotDriver, RobotState, Watch
from handeye.rpc.errors import Busy, RpcError
from handeye.server.job import Job
from handeye.server.jobs import Jobs
from handeye.server.problem import Conflict

log = structlog.get_logger(__name__)

SILENCE_LIMIT = 2.0
"""Seconds after the last sign of life at which control ends."""

_PERIOD = 0.1  # s between two looks whether the holder is there; the bridge gives up a lease that is silent for 2 s
_BRAKING = 6.0  # s that a motion may take to brake
_HEAD_TIMEOUT = 30.0  # s that the head may take to turn
_SHUTTING_DOWN = "the coordinator is shutting down"


class LeaseNeeded(Conflict):
    """The request carries no lease, or one that has ended."""

    code = "lease_needed"


class ControlledRobot(RobotDriver, Protocol):
    """A robot on the bus with all its actions, and the bridge's lease."""

    @property
    def lease_id(self) -> str:
        """The secret of the bridge's lease; empty without one."""
        ...

    def lease(self) -> AbstractContextManager[None]:
        """Holds the bridge's lease; `Busy` while another holder is alive."""
        ...

    def beat(self) -> None:
        """Shows the bridge that the lease's holder lives."""
        ...


Move = Callable[[ControlledRobot, Watch], RobotState]
"""A motion: it is given the robot, and what it calls at every control step."""


@dataclass(slots=True, eq=False)
class _Held:
    """A lease that was given out."""

    secret: str
    holder: str
    robot: ControlledRobot
    heard: float
    opened: ExitStack
    ended: threading.Event = field(default_factory=threading.Event)
    motion: Job | None = None
    keeper: threading.Thread | None = None


class Control:
    """Gives control to one holder at a time. Safe among threads."""

    def __init__(
        self,
        robot_for: Callable[[str], ControlledRobot],
        head: HeadDriver,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`robot_for` gives the robot on behalf of a holder; `clock` counts seconds."""
        self._robot_for = robot_for
        self.head = head
        self._clock = clock
        self._held: _Held | None = None
        self._taking: str | None = None
        """Who is about to get control."""
        self._closed = False
        self._lock = threading.Lock()
        """Never held while something is waited for: the event loop takes it."""

    def acquire(self, holder: str) -> str:
        """Gives control to `holder` and returns the lease, a secret; `Busy` while somebody has control."""
        with self._lock:
            self._check_open()
            self._check_free()
            self._taking = holder
        try:
            robot = self._robot_for(holder)
            with ExitStack() as opening:
                opening.enter_context(robot.lease())
                held = _Held(secrets.token_urlsafe(24), holder, robot, self._clock(), opening.pop_all())
            held.keeper = threading.Thread(target=self._keep, args=(held,), name="control", daemon=True)
            with self._lock:
                self._held = held
            held.keeper.start()
        finally:
            with self._lock:
                self._taking = None
        if self._closed:
            self._end(held, _SHUTTING_DOWN)
            self._check_open()
        log.info("control given", holder=holder)
        return held.secret

    def beat(self, lease: str) -> str:
        """A sign of life; returns who has control. `LeaseNeeded` when the lease has ended."""
        with self._lock:
            held = self._require(lease)
            held.heard = self._clock()
            return held.holder

    def heard(self, lease: str) -> None:
        """The same, for requests that can do without control: a lease that is none does not matter."""
        with suppress(LeaseNeeded):
            self.beat(lease)

    def release(self, lease: str) -> None:
        """Gives control back; a motion under way is braked. `LeaseNeeded` when the lease has ended."""
        with self._lock:
            held = self._require(lease)
        self._end(held, "its holder gave it back")

    def require_free(self) -> None:
        """`Busy` while somebody has control."""
        with self._lock:
            self._check_free()

    def move(self, lease: str, action: str, jobs: Jobs, motion: Move, finish: Callable[[Job, RobotState], None]) -> Job:
        """Starts a job that moves the robot; `finish` writes down what was reached."""

        def work(job: Job, held: _Held) -> None:
            finish(job, motion(held.robot, lambda share: self._watch(job, held, share)))

        return self._start(lease, action, jobs, work)

    def turn_head(
        self, lease: str, pan: float, tilt: float, jobs: Jobs, finish: Callable[[Job, HeadState], None]
    ) -> Job:
        """Starts a job that turns the head to (pan, tilt) in rad."""

        def work(job: Job, held: _Held) -> None:
            reached = self.head.move(
                pan, tilt, held.robot.lease_id, _HEAD_TIMEOUT, lambda: self._watch(job, held, None)
            )
            finish(job, reached)

        return self._start(lease, "head", jobs, work)

    def close(self) -> None:
        """Ends control for good; a motion under way is braked."""
        with self._lock:
            self._closed = True
            held = self._held
        if held is not None:
            self._end(held, _SHUTTING_DOWN)

    def _start(self, lease: str, action: str, jobs: Jobs, work: Callable[[Job, _Held], None]) -> Job:
        with self._lock:
            held = self._require(lease)
            held.heard = self._clock()

        def begin(job: Job) -> None:
            held.motion = job  # before it is asked whether control has ended: who ends it waits for the motion
            self._watch(job, held, None)
            work(job, held)

        return jobs.start("motion", action, None, begin, acts=True)

    def _watch(self, job: Job, held: _Held, share: float | None) -> None:
        """Called at every control step; raising brakes the motion."""
        job.check()
        if held.ended.is_set():
            raise LeaseNeeded(f"Control of '{held.holder}' has ended; the motion was braked.")
        if share is not None:
            job.report(share)

    def _check_open(self) -> None:
        if self._closed:
            raise Busy(f"Nobody gets control any more: {_SHUTTING_DOWN}.")

    def _check_free(self) -> None:
        if (holder := self._held.holder if self._held else self._taking) is not None:
            raise Busy(
                f"'{holder}' has control of the robot; it is free when they give it back, or {SILENCE_LIMIT:g} s after "
                "their last sign of life"
            )

    def _require(self, lease: str) -> _Held:
        held = self._held
        if held is None or held.ended.is_set() or not hmac.compare_digest(held.secret.encode(), lease.encode()):
            raise LeaseNeeded(
                "This needs control of the robot: get it by POST /v1/robot/lease, send it in the header Control-Lease, "
                f"and show every {SILENCE_LIMIT:g} s that you are there by PUT /v1/robot/lease."
            )
        return held

    def _keep(self, held: _Held) -> None:
        """Sends the bridge heartbeats while the holder shows signs of life, then ends control."""
        why = "it could not be kept"
        try:
            while not held.ended.wait(_PERIOD):
                if self._clock() - held.heard > SILENCE_LIMIT:
                    why = f"no sign of life for {SILENCE_LIMIT:g} s"
                    return
                try:
                    held.robot.beat()
                except RpcError as error:
                    log.warning("no heartbeat could be sent", holder=held.holder, error=str(error))
        finally:
            self._end(held, why)

    def _end(self, held: _Held, why: str) -> None:
        """Brakes what moves, then gives the bridge's lease back; once."""
        with self._lock:
            if held.ended.is_set():
                return
            held.ended.set()
        log.info("control ends", holder=held.holder, reason=why)
        try:
            if held.motion is not None:
                held.motion.wait(_BRAKING)
            held.opened.close()
        except RpcError as error:
            log.warning("the bridge was not told, and brakes by itself", holder=held.holder, error=str(error))
        finally:
            with self._lock:
                self._held = None
        if held.keeper is not None and held.keeper is not threading.current_thread():
            held.keeper.join()
