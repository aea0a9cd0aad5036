"""Pictures of a grasp, rendered without physics: cups all over the workspace, the arm near what it would do there."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from handeye.camera_bridge.driver import Frame, HeadState, Image, StereoPair
from handeye.simulation import gripper, kinematics, rig
from handeye.simulation.grasping import LIFT_HEIGHT, PARK, solve_chain
from handeye.simulation.mirror import Mirror
from handeye.simulation.objects import CUPS, ObjectSpec
from handeye.simulation.pose import Pose
from handeye.simulation.scene import WORKSPACE_CENTRE, WORKSPACE_SIZE, ObjectState, WorldState
from handeye.simulation.world import Scene

CUP = CUPS["blue cup"]
HOME = rig.rig().head.home

_SUBTASKS = ("approach", "grasp", "lift")
_SCATTER = np.array([0.02, 0.02, 0.02, 0.0, 0.02, 0.0])  # rad
_UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
_APART = 0.25  # s of world time between two pictures: their noise differs

Floats = NDArray[np.float64]


class Posed:
    """A lab of which only pictures are wanted, arm and cup as they are put: a `handeye.simulation.mirror.Source`."""

    def __init__(self) -> None:
        self._specs: tuple[ObjectSpec, ...] = ()
        self._state = self._posed(PARK, ())

    def put(self, joints: Floats, cup: Floats | None) -> None:
        """The joints (6,) in rad, and the cup's centre (3,) in m, world frame, or no cup."""
        self._specs = () if cup is None else (CUP,)
        states = () if cup is None else (ObjectState(CUP.name, Pose(cup, _UPRIGHT), False, False),)
        self._state = self._posed(joints, states)

    def _posed(self, joints: Floats, objects: tuple[ObjectState, ...]) -> WorldState:
        tool = Pose.from_matrix(kinematics.forward(joints))
        return WorldState(0.0, 0, joints, np.full(2, gripper.FINGER_TRAVEL), tool, objects)

    def scene(self) -> Scene:
        """What stands in the world."""
        return Scene(0, self._specs, 0, "default", "realtime")

    def world(self, world_time: float | None = None) -> WorldState:
        """The same at all times."""
        state = self._state
        time = world_time or 0.0
        return WorldState(time, 0, state.joints, state.fingers, state.tool, state.objects)


class Studio:
    """Takes pictures from the head's home; each of `backgrounds`, `examples` and `steps` so many pairs."""

    def __init__(self, mirror: Mirror, lab: Posed, seed: int) -> None:
        self._mirror = mirror
        self._lab = lab
        self._random = np.random.default_rng(seed)
        self._taken = 0

    def backgrounds(self, count: int) -> list[StereoPair]:
        """The empty table."""
        self._lab.put(PARK, None)
        return [self._take() for _ in range(count)]

    def examples(self, count: int) -> list[StereoPair]:
        """The cup anywhere in the workspace, the arm parked."""
        return [self._with_cup(PARK, self._place(), 0.0) for _ in range(count)]

    def steps(self, count: int) -> list[StereoPair]:
        """The arm near the end of each subtask in turn; the lifted cup is lifted."""
        taken = []
        for number in range(count):
            name, place = _SUBTASKS[number % len(_SUBTASKS)], self._place()
            joints = solve_chain(place)[name] + self._random.normal(0.0, _SCATTER)
            taken.append(self._with_cup(joints, place, LIFT_HEIGHT if name == "lift" else 0.0))
        return taken

    def _place(self) -> Floats:
        return WORKSPACE_CENTRE + WORKSPACE_SIZE * self._random.uniform(-0.5, 0.5, 2)

    def _with_cup(self, joints: Floats, place: Floats, lifted: float) -> StereoPair:
        self._lab.put(joints, np.array([*place, CUP.height / 2 + lifted]))
        return self._take()

    def _take(self) -> StereoPair:
        self._taken += 1
        time = self._taken * _APART
        left, right = (self._mirror.picture(name, time, *HOME)[0] for name in ("left", "right"))
        return pair_of(left, right, self._taken)


def pair_of(left: Image, right: Image, number: int) -> StereoPair:
    """Two pictures as a stereo pair from the head's home."""
    time = number * _APART
    return StereoPair(Frame(left, time, number), Frame(right, time, number), 0.0, HeadState(*HOME, False, time))


def write(pairs: list[StereoPair], path: Path) -> None:
    """The pictures as plain arrays in an .npz."""
    left, right = ([getattr(pair, side).image for pair in pairs] for side in ("left", "right"))
    np.savez(path, left=np.array(left), right=np.array(right))


def read(path: Path) -> list[StereoPair]:
    """What `write` wrote."""
    with np.load(path) as stored:
        sides = zip(stored["left"], stored["right"], strict=True)
        return [pair_of(left, right, number) for number, (left, right) in enumerate(sides)]


def rendered(seed: int, backgrounds: int, examples: int, steps: int) -> tuple[list[StereoPair], ...]:
    """So many pairs of each."""
    lab = Posed()
    with closing(Mirror(lab)) as mirror:
        studio = Studio(mirror, lab, seed)
        return studio.backgrounds(backgrounds), studio.examples(examples), studio.steps(steps)
