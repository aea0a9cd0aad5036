"""The teacher: plays the person with the teach pendant, in a process of its own.

It may use truth (where the cup stands) and inverse kinematics, because a person sees the cup and leads the arm by
hand. The coordinator gets from it only "look now", what the gripper does, and where demonstrations begin and end:
images and joint readings it takes itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from handeye.client import Client
from handeye.robot_bridge.driver import Pace, Watch
from handeye.robot_bridge.remote import RemoteRobot
from handeye.rpc.errors import DeadlineExceeded, Unreachable
from handeye.simulation import grasping, kinematics
from handeye.simulation.lab import LabClient
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.places import Place
from handeye.simulation.scene import WORKSPACE_CENTRE, WORKSPACE_SIZE

Array = NDArray[np.float64]

FRESH = 0.08
"""World time in s that passes at rest before each look, so that the cameras have a picture of the arm at rest."""

REST_LIMIT = 2.0
"""An arm that still moves after so many s of world time is an error."""

PACE = Pace(0.6, 0.6)


@dataclass(frozen=True, slots=True)
class Scatter:
    """How small motions around a posture are drawn: ± m along the tool's axes x, y, z, and ± rad about each of them.

    `forward` and `backward` bound z, the approach direction, apart. Half of the motions are drawn from the whole
    range, the other half from ever smaller shares of it: the last looks before a goal are the closest ones.
    """

    count: int
    x: float
    y: float
    backward: float
    forward: float
    angle: float

    def draw(self, pose: Array, random: np.random.Generator) -> list[Array]:
        """`count` poses (4, 4) around `pose`, world_from_tool."""
        return [
            self._one(pose, random, 1.0 if number % 2 == 0 else 0.5 ** random.uniform(1, 4))
            for number in range(self.count)
        ]

    def _one(self, pose: Array, random: np.random.Generator, share: float) -> Array:
        offset = random.uniform([-self.x, -self.y, -self.backward], [self.x, self.y, self.forward]) * share
        change = np.eye(4)
        change[:3, :3] = _rotation(random.uniform(-self.angle, self.angle, 3) * share)
        change[:3, 3] = offset
        moved: Array = pose @ change
        return moved


AROUND_APPROACH = Scatter(count=10, x=0.03, y=0.03, backward=0.03, forward=0.03, angle=np.radians(3.0))
AROUND_GRASP = Scatter(count=10, x=0.015, y=0.008, backward=0.04, forward=0.0, angle=np.radians(2.0))
"""Around the grasp the cup stands between the fingers: no motion may touch it."""

BACKGROUNDS = 2
"""Pictures of the empty table: they differ by their noise."""

WAY_POINTS = {"approach": 4, "grasp": 2, "lift": 2}
"""Subtask → looks on the way between its first and its last posture."""


class Teacher:
    """Shows one task with one object to a coordinator, on a robot whose control lease it holds meanwhile."""

    def __init__(
        self, robot: RemoteRobot, lab: LabClient, client: Client, spec: ObjectSpec, task: str, watch: Watch
    ) -> None:
        """`watch` is called at every control step; what it raises brakes the arm and ends the teaching."""
        self._robot = robot
        self._lab = lab
        self._client = client
        self._spec = spec
        self._task = task
        self._watch = watch

    def register_object(self, seed: int) -> None:
        """Shows the coordinator the empty table, then the object at a few places: it learns what it looks like."""
        self._lab.reset(seed)
        with self._robot.lease():
            for _ in range(BACKGROUNDS):
                self._client.add_background(self._spec.name, self._fresh())
            for number, (x, y) in enumerate(registration_places()):
                self._lab.place(self._spec, (x, y), yaw=0.5 + 1.3 * number)
                self._client.add_example(self._spec.name, self._fresh())

    def demonstrate(self, place: Place, random: np.random.Generator, on_look: Callable[[], None]) -> None:
        """One taught sequence with the object at `place`: approach, grasp, close, lift. `random` draws the motions."""
        self._lab.reset(place.seed)
        self._lab.place(self._spec, (place.x, place.y), place.yaw)
        truth = self._lab.world().object(self._spec.name).pose.position
        postures = grasping.solve_chain(truth[:2], height=float(truth[2]))
        with self._robot.lease():
            recorder = _Recorder(
                self._client, self._client.begin_demonstration(self._task, self._spec.name).id, self._settle, on_look
            )
            self._subtask(recorder, "approach", postures["approach"], AROUND_APPROACH, random)
            self._subtask(recorder, "grasp", postures["grasp"], AROUND_GRASP, random)
            self._robot.close_gripper(self._watch)
            recorder.action("grasp", "close_gripper")
            self._subtask(recorder, "lift", postures["lift"], None, random)
            recorder.finish()

    def _subtask(
        self, recorder: _Recorder, name: str, goal: Array, scatter: Scatter | None, random: np.random.Generator
    ) -> None:
        """From where the arm is to `goal`: looks at the start, on the way, at the goal, and scattered around it."""
        start = self._robot.state().joints
        recorder.look(name, key=True)
        for share in np.linspace(0.0, 1.0, WAY_POINTS[name] + 2)[1:-1]:
            self._move(start + share * (goal - start))
            recorder.look(name)
        self._move(goal)
        recorder.look(name, goal=True)
        if scatter is None:
            return
        for pose in scatter.draw(kinematics.forward(goal), random):
            self._move(near(pose, goal))
            recorder.look(name)
        self._move(goal)

    def _move(self, joints: Array) -> None:
        self._robot.move_to_joints(joints, PACE, self._watch)

    def _settle(self) -> None:
        """Lets the cameras catch up with the arm at rest; `DeadlineExceeded` when it does not come to rest."""
        state = self._robot.advance(FRESH, self._watch)
        limit = state.world_time + REST_LIMIT
        while state.world_time < state.still_since + FRESH:
            if state.world_time > limit:
                raise DeadlineExceeded(f"the arm has not come to rest within {REST_LIMIT} s of world time")
            state = self._robot.advance(FRESH, self._watch)

    def _fresh(self) -> float:
        """World time of now; the pictures of it can be had when this returns."""
        now = self._robot.state().world_time
        self._settle()
        return now


class _Recorder:
    """One demonstration as the coordinator is told of it."""

    def __init__(
        self, client: Client, demonstration: str, settle: Callable[[], None], on_look: Callable[[], None]
    ) -> None:
        self._client = client
        self._demonstration = demonstration
        self._settle = settle
        self._on_look = on_look

    def look(self, subtask: str, *, goal: bool = False, key: bool = False) -> None:
        self._settle()
        self._client.observe(self._demonstration, subtask, goal=goal, key=key)
        self._on_look()

    def action(self, subtask: str, action: Literal["close_gripper", "open_gripper"]) -> None:
        self._client.mark_action(self._demonstration, subtask, action)

    def finish(self) -> None:
        self._client.finish_demonstration(self._demonstration)


def looks_per_demonstration() -> int:
    """How many observations one taught sequence has."""
    return sum(WAY_POINTS.values()) + 2 * len(WAY_POINTS) + AROUND_APPROACH.count + AROUND_GRASP.count


def near(pose: Array, joints: Array) -> Array:
    """The joints that reach `pose`, on the branch nearest to `joints`."""
    solutions = kinematics.inverse(pose)
    if not len(solutions):
        raise Unreachable(f"no joint position reaches a small motion around {np.round(joints, 3).tolist()}")
    return kinematics.nearest(solutions, joints)


def registration_places() -> list[Array]:
    """Four places of the workspace, away from its edges and from each other."""
    offsets = np.array([[-0.25, -0.3], [0.3, -0.15], [-0.1, 0.3], [0.15, 0.1]])
    return list(WORKSPACE_CENTRE + WORKSPACE_SIZE * offsets)


def _rotation(vector: Array) -> Array:
    """Rotation matrix of a rotation vector (3,) in rad (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Array = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return rotation
