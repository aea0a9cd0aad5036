"""The simulated world: who may do what with its physics, when; its clock and its truth."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from handeye.rpc.errors import Busy, Internal, InvalidArgument
from handeye.simulation import gripper, placement
from handeye.simulation.clock import RealtimeClock
from handeye.simulation.conditions import ORDINARY, Conditions
from handeye.simulation.motion import JointMotion
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.physics import Physics
from handeye.simulation.pose import Pose
from handeye.simulation.profile import Profile
from handeye.simulation.scene import STEP, WorldState

Array = NDArray[np.float64]
Clock = Literal["lockstep", "realtime"]

_SOLVER_ITERATIONS = 60
_PLACEMENT_STEPS = 48
_FILLING_STEPS = 240


@dataclass(frozen=True, slots=True)
class Scene:
    """What stands in the world; `version` changes with every reset and every object placed, held, filled, removed."""

    version: int
    objects: tuple[ObjectSpec, ...]
    seed: int
    profile: str
    clock: Clock
    conditions: Conditions = ORDINARY


class World:
    """A PyBullet world with the robot and the objects on the table; every public call is thread-safe by `lock`.

    In lockstep nothing moves unless somebody calls `step`; with the realtime clock a thread of the world steps it and
    others wait for it. The same profile, seed and calls give the same states, bit for bit.
    `close` ends thread and physics.

    Args:
        profile: how far from ideal robot and sensors are.
        seed: of everything random.
        clock: "lockstep" or "realtime".
        grip_force: force of each finger, in N.
    """

    def __init__(
        self, profile: Profile, seed: int = 0, clock: Clock = "lockstep", *, grip_force: float = gripper.FORCE
    ) -> None:
        self.profile = profile
        self.clock: Clock = clock
        self.lock = threading.RLock()
        self._stepped = threading.Condition(self.lock)
        self._ticks = 0
        self._advancing = False
        self._failure: Exception | None = None
        self._physics = Physics(profile, grip_force, seed)
        self._realtime = RealtimeClock(self.step, self._fail) if clock == "realtime" else None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stops the clock and frees the physics; may be called twice."""
        if self._realtime is not None:
            self._realtime.close()
        with self.lock:
            self._physics.close()
            self._stepped.notify_all()

    # Time

    @property
    def time(self) -> float:
        """World time since the reset, in s."""
        return self._physics.steps * STEP

    @property
    def ticks(self) -> int:
        """Physics steps since the world was made; resets do not turn it back."""
        return self._ticks

    def step(self) -> None:
        """Lets one physics step of world time pass."""
        with self.lock:
            self._require_open()
            self._physics.step()
            self._ticks += 1
            self._stepped.notify_all()

    def wait_for_tick(self, after: int, timeout: float) -> bool:
        """Waits until `ticks` exceeds `after`; False when `timeout` s of wall time ran out first.

        Raises:
            Internal: the clock's thread has died, or the world is closed.
        """
        with self.lock:
            passed = self._stepped.wait_for(
                lambda: self._ticks > after or self._failure is not None or self._physics.client < 0, timeout
            )
            if self._failure is not None:
                raise Internal(f"the world's clock has died: {self._failure}")
            self._require_open()
            return passed

    def _fail(self, error: Exception) -> None:
        with self.lock:
            self._failure = error
            self._stepped.notify_all()

    # Commands, for the driver

    def start_motion(self, goal: Array, *, speed_share: float, acceleration_share: float) -> JointMotion:
        """Starts moving the motors to `goal` (6,), rad, within shares of the limits; `Busy` during another motion."""
        with self.lock:
            self._require_idle()
            motion = JointMotion(
                self._physics.arm.motor, goal, speed_share=speed_share, acceleration_share=acceleration_share, step=STEP
            )
            self._physics.arm.follow(motion)
            self._physics.stillness.begin()
            return motion

    def start_gripper(self, *, opening: bool) -> None:
        """Starts to open or close the gripper; `Busy` during another motion."""
        with self.lock:
            self._require_idle()
            if opening:
                self._physics.gripper.open(self._physics.fingers)
            else:
                self._physics.gripper.close()
            self._physics.stillness.begin()

    @contextmanager
    def advancing(self) -> Iterator[None]:
        """While world time is let pass with the arm at rest: the same as a motion to those who would be `Busy`."""
        with self.lock:
            self._advancing = True
        try:
            yield
        finally:
            self._advancing = False

    def brake(self) -> None:
        """Brings arm and fingers to a standstill within the acceleration limits."""
        with self.lock:
            self._physics.arm.brake()
            self._physics.gripper.hold(self._physics.fingers)

    def let_go(self) -> None:
        """Begins to open the gripper, also while the arm moves."""
        with self.lock:
            self._physics.gripper.open(self._physics.fingers)

    @property
    def busy(self) -> bool:
        """A motion is under way or has not settled yet."""
        return self._physics.stillness.busy

    @property
    def still_since(self) -> float:
        """World time since when arm and fingers stand still, in s; infinite while they move."""
        return self._physics.stillness.since(self._physics.steps)

    @property
    def gripper_fraction(self) -> float:
        """Share of the fingers' way done, 0..1."""
        return self._physics.gripper.fraction

    # Sensors, for the driver

    def encoders(self) -> Array:
        """What the joints' encoders read (6,), rad."""
        with self.lock:
            return self._physics.arm.encoders(self._physics.joints)

    def motors(self) -> Array:
        """Where the motors are led to (6,), rad: the start of the next motion."""
        with self.lock:
            return self._physics.arm.motor

    def velocities(self) -> Array:
        """How fast the motors turn, counted at the joints (6,), rad/s."""
        with self.lock:
            return self._physics.arm.motor_speed

    def gripper_opening(self) -> float:
        """Distance between the pads, in m."""
        with self.lock:
            return float(self._physics.fingers.sum())

    # Truth, for the lab bus

    def scene(self) -> Scene:
        """What stands in the world."""
        with self.lock:
            now = self._physics
            return Scene(
                now.version, tuple(now.specs.values()), now.seed, self.profile.name, self.clock, now.conditions
            )

    def state(self, world_time: float | None = None) -> WorldState:
        """The truth now, or at a past world time (to the nearest physics step).

        Raises:
            InvalidArgument: the time is no finite number, lies in the future, or further back than `history.REACH`.
        """
        with self.lock:
            step = self._physics.steps if world_time is None else _steps("world_time", world_time)
            return self._physics.history.recall(step)

    def history(self, start: float, end: float | None = None, every: float = 0.0) -> list[WorldState]:
        """The truth from `start` to `end` (None: now), one state every `every` s (0: every step), oldest first."""
        with self.lock:
            first, stride = _steps("start", start), max(1, _steps("every", every))
            last = self._physics.steps if end is None else _steps("end", end)
            return [self._physics.history.recall(step) for step in range(first, last + 1, stride)]

    # Changes, for the lab bus

    def reset(self, seed: int = 0, conditions: Conditions = ORDINARY) -> Scene:
        """Rebuilds the world: arm parked, gripper open, no objects, world time 0. `Busy` during motion or advance."""
        with self.lock:
            self._require_open()
            self._require_idle()
            self._physics.build(seed, conditions)
            return self.scene()

    def place(self, spec: ObjectSpec, xy: Sequence[float] | Array, yaw: float = 0.0) -> Scene:
        """Puts an object on the table and lets it settle, which takes 0.2 s of world time.

        An object of the same name is replaced.

        Args:
            spec: what to place.
            xy: where its axis meets the table, in m, world frame.
            yaw: rotation about the vertical, in rad.

        Raises:
            Busy: during a motion, or while the robot lets time pass.
            InvalidArgument: place or yaw is not finite, or the place is off the table or taken. The world is as it was.
        """
        with self.lock:
            self._require_open()
            self._require_idle()
            position = np.array(xy, dtype=np.float64)
            placement.require_on_table(spec, position, yaw)
            self._physics.put(spec, placement.standing(spec, position, yaw))
            for _ in range(_PLACEMENT_STEPS):
                self.step()
            return self.scene()

    def hold(self, spec: ObjectSpec, pose: Pose) -> Scene:
        """Holds an object in the air, as on a stand or a thread: it collides, but nothing moves it. Takes no time.

        An object of the same name is replaced, also one that stands on the table. `remove` and `reset` take it away.

        Args:
            spec: what to hold.
            pose: where its body frame is; a quaternion whose length is 1 to 1e-6 is normalised.

        Raises:
            Busy: during a motion, or while the robot lets time pass.
            InvalidArgument: the pose is not finite, out of the lab or no rotation; or another object, the robot, the
                table or the floor is there. The world is as it was.
        """
        with self.lock:
            self._require_open()
            self._require_idle()
            self._physics.put(spec, placement.checked(spec, pose), fixed=True)
            return self.scene()

    def fill(self, name: str, particles: int) -> Scene:
        """Fills liquid into a cup that stands upright and lets it settle, which takes 1 s of world time.

        Physics with it is several times slower: liquid is only where it is asked for. `reset` takes it away.

        Raises:
            Busy: during a motion, or while the robot lets time pass.
            InvalidArgument: there is no such object, it holds no liquid or not so much, or there is liquid already.
        """
        with self.lock:
            self._require_open()
            self._require_idle()
            self._physics.fill(name, particles)
            for _ in range(_FILLING_STEPS):
                self.step()
            return self.scene()

    def push(self, name: str, path: Sequence[Sequence[float]] | Array, speed: float) -> float:
        """Begins to push an object along the table, as with a stick; returns the world time at which it will be there.

        The push goes on while world time passes, whatever the robot does meanwhile; another one replaces it. It ends
        when the object is placed, held or taken away, or when the robot touches it: then it stays where it is.

        Args:
            name: which object.
            path: places (x, y) its axis is led to, one after the other, in m, world frame.
            speed: in m/s; it begins and ends gently.

        Raises:
            InvalidArgument: no such object, or it cannot be pushed there. The world is as it was.
        """
        with self.lock:
            self._require_open()
            return self.time + self._physics.push(name, np.array(path, dtype=np.float64), speed)

    def remove(self, name: str) -> Scene:
        """Takes an object away; `InvalidArgument` when there is none of that name."""
        with self.lock:
            self._require_open()
            self._physics.remove(name)
            return self.scene()

    # Inside

    def _require_idle(self) -> None:
        if self._physics.stillness.busy or self._advancing:
            raise Busy("a motion is under way; wait for its end or stop the robot")

    def _require_open(self) -> None:
        if self._physics.client < 0:
            raise Internal("the simulated world is closed")


def _steps(name: str, time: float) -> int:
    """`time` s in physics steps, to the nearest."""
    steps = time / STEP
    if not math.isfinite(steps):
        raise InvalidArgument(f"{name} must be a finite number of seconds, got {time}", detail=name)
    return round(steps)
