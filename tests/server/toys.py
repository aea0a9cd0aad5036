"""A toy world without physics: a linear arm, and cameras whose pictures are read from the world itself."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from handeye.camera_bridge.driver import Course, Frame, HeadState, Image, StereoPair, Tick
from handeye.modules.recognition import HandNotSeen, NotSeen
from handeye.modules.spaces import HeadAngles, ImagePair, ImagePoint
from handeye.robot_bridge.driver import Joints, Pace, RobotDescription, RobotState, Watch, unwatched
from handeye.rpc.errors import Busy, DeadlineExceeded, OutOfLimits, RpcError, Stopped, Unauthorised, Unavailable

JOINTS = 6
STEP = 0.01
LATENCY = 0.05
PARK = np.array([0.5, -0.5, 0.4, 0.0, 0.3, 0.0])


@dataclass
class World:
    """World time, the arm, the gripper and one cup; the hand's place in the stereo image is linear in three joints."""

    time: float = 0.0
    joints: Joints = field(default_factory=lambda: PARK.copy())
    gripper: float = 0.09
    still_since: float = 0.0
    moving: bool = False
    cup: NDArray[np.float64] = field(default_factory=lambda: np.array([240.0, 320.0, 150.0]))
    others: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    """Where other objects than the cup are, by name."""
    reads: float = 1.0
    """Share of a motion that the joints really make: the arm is not exact."""
    hidden: set[str] = field(default_factory=set)
    head: tuple[float, float] = (0.0, 0.0)
    """(pan, tilt) in rad."""
    history: list[tuple[float, NDArray[np.float64]]] = field(default_factory=list)

    @property
    def hand(self) -> NDArray[np.float64]:
        """(row, column, disparity) of the hand."""
        return np.array([240.0, 320.0, 150.0]) + np.array([100.0, 120.0, 60.0]) * self.joints[:3]

    @property
    def shift(self) -> NDArray[np.float64]:
        """(rows, columns, 0) by which everything is seen elsewhere because the head is turned."""
        pan, tilt = self.head
        return np.array([600.0 * np.tan(tilt), 600.0 * np.tan(pan), 0.0])

    @property
    def point(self) -> NDArray[np.float64]:
        """Where the robot has the tool centre point, in m: linear in the first three joints, 0.3 m for each rad."""
        return np.array([0.5, 0.0, 0.2]) + 0.3 * self.joints[:3]

    def goal_joints(self, lift: float = 0.0) -> Joints:
        """Where the hand is at the cup; `lift` rad above it."""
        joints = np.zeros(JOINTS)
        joints[:3] = (self.cup - [240.0, 320.0, 150.0]) / [100.0, 120.0, 60.0]
        joints[3] = lift
        return joints


class ToyRobot:
    """A robot in lockstep with the toy world; records every command by name."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.commands: list[str] = []
        self.stopped = ""
        self.leased = False
        self.lease_id = ""
        self.fail_with: RpcError | None = None
        self.on_step: threading.Event | None = None
        self.hang = False
        self.pause = threading.Event()
        self.beats = 0
        self.paces: list[float] = []
        """Share of the speed limits of each change of the joints."""

    description = RobotDescription(
        joint_names=tuple(f"joint{n}" for n in range(1, 7)),
        lower=np.full(JOINTS, -3.0),
        upper=np.full(JOINTS, 3.0),
        speed=np.ones(JOINTS),
        acceleration=np.ones(JOINTS),
        park=PARK,
        gripper_range=0.09,
        clock="lockstep",
    )

    @contextmanager
    def lease(self) -> Iterator[None]:
        if self.leased:
            raise Busy("the control lease is held by 'teacher'")
        self.leased, self.lease_id = True, "a lease"
        try:
            yield
        finally:
            self.leased, self.lease_id = False, ""

    def beat(self) -> None:
        self.beats += 1

    def state(self) -> RobotState:
        if isinstance(self.fail_with, Unavailable):
            raise self.fail_with
        world = self.world
        return RobotState(
            world.time,
            world.joints.copy(),
            np.zeros(JOINTS),
            world.point,
            world.gripper,
            world.moving,
            bool(self.stopped),
            np.inf if world.moving else world.still_since,
        )

    def _command(self, name: str, duration: float, watch: Watch, moves: bool = True) -> None:
        self.commands.append(name)
        if self.fail_with is not None:
            raise self.fail_with
        if not self.leased:
            raise Unauthorised("moving the robot needs the control lease")
        if self.stopped and moves:
            raise Stopped(f"the robot is stopped: {self.stopped}")
        self.world.moving = moves
        steps = max(1, round(duration / STEP))
        try:
            done = 0
            while done < steps or self.hang:
                self.world.time += STEP
                if self.hang:
                    self.pause.wait(0.001)  # lets the other threads run
                done += 1
                watch(min(1.0, done / steps))
                if self.on_step is not None:
                    self.on_step.set()
        finally:
            self.world.moving = False
            if moves:
                self.world.still_since = self.world.time

    def adjust_joints(
        self,
        delta: Joints,
        pace: Pace = Pace(),  # noqa: B008
        watch: Watch = unwatched,
        least_opening: float = 0.0,
    ) -> RobotState:
        self.paces.append(pace.speed)
        self._command("adjust_joints", 1.0, watch)
        self.world.joints = self.world.joints + self.world.reads * np.asarray(delta)
        return self.state()

    def open_gripper(self, watch: Watch = unwatched) -> RobotState:
        self._command("open_gripper", 0.2, watch)
        self.world.gripper = 0.09
        return self.state()

    def close_gripper(self, watch: Watch = unwatched) -> RobotState:
        self._command("close_gripper", 0.2, watch)
        self.world.gripper = 0.065
        return self.state()

    def advance(self, duration: float, watch: Watch = unwatched) -> RobotState:
        self._command("advance", duration, watch, moves=False)
        return self.state()

    def park(self, pace: Pace = Pace(), watch: Watch = unwatched) -> RobotState:  # noqa: B008
        self._command("park", 1.0, watch)
        self.world.joints = PARK.copy()
        return self.state()

    def move_to_point(self, point: NDArray[np.float64], pace: Pace = Pace(), watch: Watch = unwatched) -> RobotState:  # noqa: B008
        self._command("move_to_point", 1.0, watch)
        return self.state()

    def move_to_joints(self, joints: Joints, pace: Pace = Pace(), watch: Watch = unwatched) -> RobotState:  # noqa: B008
        self._command("move_to_joints", 1.0, watch)
        self.world.joints = np.array(joints)
        return self.state()

    def stop(self, reason: str = "") -> RobotState:
        self.commands.append("stop")
        if isinstance(self.fail_with, Unavailable):
            raise self.fail_with
        self.stopped = reason or "stopped"
        return self.state()

    def reset(self) -> RobotState:
        self.stopped = ""
        return self.state()

    def close(self) -> None:
        """Nothing to release."""


class ToyCameras:
    """Pictures whose first numbers are where object and hand are: what `ToySight` reads back."""

    size = (48, 64)
    latency = LATENCY

    def __init__(self, world: World) -> None:
        self.world = world
        self.fail_with: RpcError | None = None
        self.sequence = 0
        self.gate: threading.Event | None = None
        """Pictures are waited for until it is set."""
        self.waiting = threading.Event()
        """Somebody waits for a picture."""

    def grab_stereo(self, not_older_than: float, timeout: float, on_tick: Tick | None = None) -> StereoPair:
        if self.fail_with is not None:
            raise self.fail_with
        while self.gate is not None and not self.gate.wait(0.005):
            self.waiting.set()
            if on_tick is not None:
                on_tick()
        newest = self.world.time - LATENCY
        if newest < not_older_than:
            raise DeadlineExceeded(f"the newest pair shows {newest:.3f} s, {not_older_than:.3f} s was asked for")
        self.sequence += 1
        frame = Frame(np.zeros((*self.size, 3), np.uint8), newest, self.sequence)
        return StereoPair(frame, frame, 0.0, HeadState(*self.world.head, False, newest))

    def grab_observer(self, not_older_than: float, timeout: float) -> Frame:
        return self.grab_stereo(not_older_than, timeout).left

    def close(self) -> None:
        """Nothing to release."""


class ToyHead:
    """A head that turns at once."""

    limits = ((-1.0, 1.0), (-0.5, 0.5))
    step = 0.0
    speed = 1.0

    def __init__(self, world: World) -> None:
        self.world = world

    def state(self) -> HeadState:
        return HeadState(*self.world.head, False, self.world.time)

    def move(self, pan: float, tilt: float, lease_id: str, timeout: float, on_tick: Tick | None = None) -> HeadState:
        if not lease_id:
            raise Unauthorised("the head needs the control lease")
        if on_tick is not None:
            on_tick()
        for angle, (low, high) in zip((pan, tilt), self.limits, strict=True):
            if not low <= angle <= high:
                raise OutOfLimits(f"the head cannot turn to {angle:.3f} rad")
        self.world.head = (pan, tilt)
        return self.state()

    def follow(self, course: Course, lasting: float, lease_id: str, timeout: float) -> HeadState:
        if not lease_id:
            raise Unauthorised("the head needs the control lease")
        self.world.head = course.at(self.world.time)
        return self.state()

    def close(self) -> None:
        """Nothing to release."""


class ToySight:
    """Sees where the toy world says that things are, to a tenth of a pixel."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.learned: dict[str, tuple[int, int]] = {}

    def learn(self, name: str, backgrounds: list[Image], examples: list[Image]) -> None:
        self.learned[name] = (len(backgrounds), len(examples))

    def forget(self, name: str) -> None:
        self.learned.pop(name, None)

    def see(self, left: Image, right: Image, name: str, head: HeadAngles, /) -> ImagePair:
        return ImagePair(object=self.see_object(left, right, name, head)[0], hand=self.see_hand(left, right, head)[0])

    def see_object(self, _left: Image, _right: Image, name: str, _head: HeadAngles, /) -> tuple[ImagePoint, float]:
        return self._seen("object", name, self.world.others.get(name, self.world.cup))

    def see_hand(self, _left: Image, _right: Image, _head: HeadAngles, /) -> tuple[ImagePoint, float]:
        return self._seen("hand", "marker 7", self.world.hand)

    def _seen(self, what: str, name: str, place: NDArray[np.float64]) -> tuple[ImagePoint, float]:
        if what in self.world.hidden:
            raise (HandNotSeen if what == "hand" else NotSeen)(f"{what} '{name}' is not seen in the left picture")
        return ImagePoint(*np.round(place + self.world.shift, 1).tolist()), 1.0
