"""The simulated world: physics, its controllers, its clock and its truth."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import Literal, Self

import numpy as np
import pybullet
from numpy.typing import NDArray

from handeye.rpc.errors import Busy, Internal, InvalidArgument
from handeye.simulation import gripper, kinematics, liquid, placement, scene
from handeye.simulation.clock import RealtimeClock
from handeye.simulation.conditions import ORDINARY, Conditions
from handeye.simulation.controllers import ArmController, GripperController
from handeye.simulation.grasping import PARK
from handeye.simulation.history import History, Row
from handeye.simulation.mishaps import Mishaps
from handeye.simulation.motion import JointMotion
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.pose import Pose
from handeye.simulation.profile import Profile
from handeye.simulation.pushing import Push
from handeye.simulation.scene import ARM_JOINTS, FINGER_1, FINGER_2, STEP, WorldState
from handeye.simulation.stillness import Stillness

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
        self._grip_force = grip_force
        self._version = 0
        self._ticks = 0
        self._advancing = False
        self._failure: Exception | None = None
        self._client: int = pybullet.connect(pybullet.DIRECT)
        if self._client < 0:
            raise Internal("PyBullet gives no physics client: too many are open in this process")
        self._build(seed, ORDINARY)
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
            if self._client >= 0:
                pybullet.disconnect(physicsClientId=self._client)
                self._client = -1
            self._stepped.notify_all()

    # Time

    @property
    def time(self) -> float:
        """World time since the reset, in s."""
        return self._step * STEP

    @property
    def ticks(self) -> int:
        """Physics steps since the world was made; resets do not turn it back."""
        return self._ticks

    def step(self) -> None:
        """Lets one physics step of world time pass."""
        with self.lock:
            self._require_open()
            if self._mishaps is not None:
                tool = kinematics.forward(self._joints)[:3, 3]
                self._mishaps.before_step(tool, moving=self._stillness.busy)
            self._arm.drive()
            self._gripper.drive()
            for name in [name for name, push in self._pushes.items() if not push.drive()]:
                del self._pushes[name]
            pybullet.stepSimulation(physicsClientId=self._client)
            self._step += 1
            self._ticks += 1
            self._observe()
            self._history.append(self._row())
            self._stepped.notify_all()

    def wait_for_tick(self, after: int, timeout: float) -> bool:
        """Waits until `ticks` exceeds `after`; False when `timeout` s of wall time ran out first.

        Raises:
            Internal: the clock's thread has died, or the world is closed.
        """
        with self.lock:
            passed = self._stepped.wait_for(
                lambda: self._ticks > after or self._failure is not None or self._client < 0, timeout
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
                self._arm.motor, goal, speed_share=speed_share, acceleration_share=acceleration_share, step=STEP
            )
            self._arm.follow(motion)
            self._stillness.begin()
            return motion

    def start_gripper(self, *, opening: bool) -> None:
        """Starts to open or close the gripper; `Busy` during another motion."""
        with self.lock:
            self._require_idle()
            if opening:
                self._gripper.open()
            else:
                self._gripper.close()
            self._stillness.begin()

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
            self._arm.brake()
            self._gripper.hold(self._fingers)

    @property
    def busy(self) -> bool:
        """A motion is under way or has not settled yet."""
        return self._stillness.busy

    @property
    def still_since(self) -> float:
        """World time since when arm and fingers stand still, in s; infinite while they move."""
        return self._stillness.since(self._step)

    @property
    def gripper_fraction(self) -> float:
        """Share of the fingers' way done, 0..1."""
        return self._gripper.fraction

    # Sensors, for the driver

    def encoders(self) -> Array:
        """What the joints' encoders read (6,), rad."""
        with self.lock:
            return self._arm.encoders(self._joints)

    def motors(self) -> Array:
        """Where the motors are led to (6,), rad: the start of the next motion."""
        with self.lock:
            return self._arm.motor

    def velocities(self) -> Array:
        """How fast the motors turn, counted at the joints (6,), rad/s."""
        with self.lock:
            return self._arm.motor_speed

    def gripper_opening(self) -> float:
        """Distance between the pads, in m."""
        with self.lock:
            return float(self._fingers.sum())

    # Truth, for the lab bus

    def scene(self) -> Scene:
        """What stands in the world."""
        with self.lock:
            return Scene(
                self._version, tuple(self._specs.values()), self._seed, self.profile.name, self.clock, self._conditions
            )

    def state(self, world_time: float | None = None) -> WorldState:
        """The truth now, or at a past world time (to the nearest physics step).

        Raises:
            InvalidArgument: the time is no finite number, lies in the future, or further back than `history.REACH`.
        """
        with self.lock:
            step = self._step if world_time is None else _steps("world_time", world_time)
            return self._history.recall(step)

    def history(self, start: float, end: float | None = None, every: float = 0.0) -> list[WorldState]:
        """The truth from `start` to `end` (None: now), one state every `every` s (0: every step), oldest first."""
        with self.lock:
            first, stride = _steps("start", start), max(1, _steps("every", every))
            last = self._step if end is None else _steps("end", end)
            return [self._history.recall(step) for step in range(first, last + 1, stride)]

    # Changes, for the lab bus

    def reset(self, seed: int = 0, conditions: Conditions = ORDINARY) -> Scene:
        """Rebuilds the world: arm parked, gripper open, no objects, world time 0. `Busy` during motion or advance."""
        with self.lock:
            self._require_open()
            self._require_idle()
            self._build(seed, conditions)
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
            self._put(spec, placement.standing(spec, position, yaw))
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
            self._put(spec, placement.checked(spec, pose), fixed=True)
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
            spec = self._known(name)
            if self._stage.particles:
                raise InvalidArgument("there is liquid in the world already; reset the world first", detail="name")
            if particles < 1:
                raise InvalidArgument(f"at least one particle must be filled in, got {particles}", detail="particles")
            pose = self.state().object(name).pose
            where = liquid.places(spec, pose, particles, np.random.default_rng(self._seed))
            self._stage.fill(where)
            self._changed()
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
            push = Push(self._stage, self._known(name), np.array(path, dtype=np.float64), speed)
            self._pushes[name] = push
            return self.time + push.duration

    def remove(self, name: str) -> Scene:
        """Takes an object away; `InvalidArgument` when there is none of that name."""
        with self.lock:
            self._require_open()
            self._known(name)
            del self._specs[name]
            self._pushes.pop(name, None)
            self._stage.remove(name)
            self._changed()
            return self.scene()

    # Inside

    def _known(self, name: str) -> ObjectSpec:
        if name not in self._specs:
            known = ", ".join(self._specs) or "none"
            raise InvalidArgument(f"no object {name!r} is in the world; there are: {known}", detail="name")
        return self._specs[name]

    def _put(self, spec: ObjectSpec, pose: Pose, *, fixed: bool = False) -> None:
        placement.put(self._stage, spec, pose, fixed=fixed)
        self._pushes.pop(spec.name, None)
        self._specs.pop(spec.name, None)  # what replaces another counts as put last
        self._specs[spec.name] = spec
        self._changed()

    def _build(self, seed: int, conditions: Conditions) -> None:
        client = self._client
        pybullet.resetSimulation(physicsClientId=client)
        pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=STEP,
            numSolverIterations=_SOLVER_ITERATIONS,
            contactBreakingThreshold=0.001,
            enableConeFriction=1,
            deterministicOverlappingPairs=1,
            physicsClientId=client,
        )
        self._seed = seed
        self._conditions = conditions
        self._stage = scene.build(client)
        offsets, travel = np.array(conditions.joint_offsets), conditions.opening / 2
        self._arm = ArmController(self._stage, self.profile, PARK, offsets, np.random.default_rng(seed))
        self._gripper = GripperController(self._stage, self._grip_force, travel)
        self._stage.set_joints(self._arm.link, np.full(2, travel))
        self._mishaps = Mishaps(self._stage, conditions) if conditions != ORDINARY else None
        self._specs: dict[str, ObjectSpec] = {}
        self._pushes: dict[str, Push] = {}
        self._history = History()
        self._step = 0
        self._stillness = Stillness()
        self._version += 1
        self._read_joints()
        self._history.append(self._row())

    def _observe(self) -> None:
        """Reads the joints and judges whether arm and gripper stand still."""
        self._gripper.observe(self._read_joints())
        led = self._arm.motion is not None or not self._gripper.settled
        self._stillness.observe(self._joints, led=led)

    def _read_joints(self) -> float:
        """Takes the positions; returns the greatest speed of the fingers, in m/s."""
        states = pybullet.getJointStates(
            self._stage.robot, (*ARM_JOINTS, FINGER_1, FINGER_2), physicsClientId=self._client
        )
        self._joints: Array = np.array([state[0] for state in states[:6]])
        self._fingers: Array = np.array([state[0] for state in states[6:]])
        return float(max(abs(state[1]) for state in states[6:]))

    def _row(self) -> Row:
        """Joints, fingers, objects and liquid as they are."""
        numbers = [*self._joints, *self._fingers]
        for body in self._stage.objects.values():
            position, orientation = pybullet.getBasePositionAndOrientation(body, physicsClientId=self._client)
            numbers += [*position, *orientation, *self._touches(body)]
        if self._stage.particles:
            numbers += liquid.read(self._client, self._stage.particles).ravel().tolist()
        return Row(self._version, tuple(self._stage.objects), np.array(numbers))

    def _touches(self, body: int) -> tuple[bool, bool]:
        contacts = pybullet.getContactPoints(self._stage.robot, body, physicsClientId=self._client)
        pressed = {contact[3] for contact in contacts if contact[9] > 0.0}
        return FINGER_1 in pressed, FINGER_2 in pressed

    def _changed(self) -> None:
        """The scene is another one now, and so is the newest state."""
        self._version += 1
        self._history.replace(self._row())

    def _require_idle(self) -> None:
        if self._stillness.busy or self._advancing:
            raise Busy("a motion is under way; wait for its end or stop the robot")

    def _require_open(self) -> None:
        if self._client < 0:
            raise Internal("the simulated world is closed")


def _steps(name: str, time: float) -> int:
    """`time` s in physics steps, to the nearest."""
    steps = time / STEP
    if not math.isfinite(steps):
        raise InvalidArgument(f"{name} must be a finite number of seconds, got {time}", detail=name)
    return round(steps)
