"""What the teacher can show: for each task the objects, where they stand, and the moves of a demonstration.

A person sees where things stand and leads the arm there; in the lab that is truth and inverse kinematics. All of it
reaches the coordinator only as looks, joint readings and gripper actions: it knows none of these tasks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from handeye.simulation import grasping, kinematics, pouring
from handeye.simulation.objects import JAR, STAND, ObjectSpec
from handeye.simulation.places import Area, Place, Purpose, draw, draw_in
from handeye.simulation.scatter import Elsewhere, Scatter
from handeye.simulation.scene import WorldState

Array = NDArray[np.float64]

CUPS_AREA = Area((0.53, -0.16), 0.18)
JARS_AREA = Area((0.53, 0.16), 0.18)
"""Where a task with two objects has them: both cameras see both areas whole, and the hand has room between them."""

AROUND_APPROACH = Scatter(count=10, x=0.03, y=0.03, backward=0.03, forward=0.03, angle=np.radians(3.0))
BEFORE_APPROACH = Elsewhere(count=12, aside=0.15, along=0.15, above=0.12)
"""So one showing also tells how the hand is to go where the object stands elsewhere."""
AROUND_GRASP = Scatter(count=10, x=0.015, y=0.008, backward=0.04, forward=0.0, angle=np.radians(2.0))
"""Around the grasp the cup stands between the fingers: no motion may touch it."""
AROUND_HELD = Scatter(count=8, x=0.02, y=0.02, backward=0.02, forward=0.02, angle=np.radians(3.0))
AROUND_RELEASE = Scatter(count=8, x=0.03, y=0.02, backward=0.02, forward=0.02, angle=np.radians(1.0), above=True)
"""Around where the cup is let go: never lower."""

_DROP = 0.002  # m: a cup is let go so far above what it is to stand on, lest it is pressed down
_EMPTYING = 1.0  # s that a cup is held turned


@dataclass(frozen=True, slots=True)
class Move:
    """One subtask as it is shown: the hand goes to `goal` (6,), rad, with so many looks on the straight way there."""

    subtask: str
    goal: Array | None
    """None: it stays where it is."""
    looks: int
    scatter: Scatter | None
    towards: str | None = None
    """The object that it is towards; None: the first one."""
    way: tuple[Array | float, ...] = ()
    """What follows without looking: joints (6,), rad, to go to, or s to wait."""
    elsewhere: Elsewhere | None = None
    """Where else the hand is led from the goal, to be looked at there, before it comes back."""
    action: Literal["close_gripper", "open_gripper"] | None = None


@dataclass(frozen=True, slots=True)
class Lesson:
    """A task that can be shown."""

    name: str
    objects: tuple[ObjectSpec, ...]
    """The first one is what the task is done with."""
    draw: Callable[[int, Purpose, int], tuple[tuple[Place, ...], ...]]
    """(seed, purpose, count) -> where the objects stand, `count` times; the first place's seed is the world's."""
    plan: Callable[[WorldState], tuple[Move, ...]]
    """The moves that do it with the objects where they stand; `Unreachable` says what the arm cannot."""


def grasp(spec: ObjectSpec) -> Lesson:
    """Table 4.1's task, and a lift."""

    def places(seed: int, purpose: Purpose, count: int) -> tuple[tuple[Place, ...], ...]:
        return tuple((place,) for place in draw(seed, purpose, count))

    def plan(world: WorldState) -> tuple[Move, ...]:
        chain = _chain(world, spec)
        return (
            *_taking(chain, looks=4),
            Move("lift", None, 0, None, way=(chain["lift"],)),
            # What it looks like when it is held: what does not look so has slipped.
            Move("hold", None, 0, None),
        )

    return Lesson("grasp", (spec,), places, plan)


def pour(spec: ObjectSpec) -> Lesson:
    """Table 4.2's task: the cup is taken, emptied into the jar, and set down beside it."""

    def plan(world: WorldState) -> tuple[Move, ...]:
        chain = _chain(world, spec)
        jar = world.object(JAR.name).pose.position[:2]
        pours = pouring.pouring_chain(jar, JAR, spec, chain["grasp"])
        (above,), (start,), (beside,) = pours["above"], pours["start"], pours["beside"]
        return (
            *_taking(chain, looks=3),
            Move("delivery", above, 3, AROUND_HELD, JAR.name),
            Move("pour", start, 1, AROUND_HELD, JAR.name, way=(*pours["turned"], _EMPTYING, start)),
            Move("replace", _raised(beside, _DROP), 3, AROUND_RELEASE, JAR.name, action="open_gripper"),
        )

    return Lesson("pour", (spec, JAR), _two_areas, plan)


def stack(spec: ObjectSpec) -> Lesson:
    """The cup is put on a stand. The last piece goes down without looking: there the cup hides the stand."""

    def plan(world: WorldState) -> tuple[Move, ...]:
        chain = _chain(world, spec)
        stand = world.object(STAND.name).pose.position[:2]
        high, near, down = (
            pouring.standing_on(stand, STAND.height + above, spec, chain["grasp"]) for above in (0.10, 0.05, _DROP)
        )
        return (
            *_taking(chain, looks=3),
            Move("carry", high, 3, AROUND_HELD, STAND.name),
            Move("put", near, 1, AROUND_HELD, STAND.name, way=(down,), action="open_gripper"),
        )

    return Lesson("stack", (spec, STAND), _two_areas, plan)


LESSONS: dict[str, Callable[[ObjectSpec], Lesson]] = {"grasp": grasp, "pour": pour, "stack": stack}
"""By name, for the cup to do them with."""


def _chain(world: WorldState, spec: ObjectSpec) -> dict[str, Array]:
    """The joints of "approach", "grasp" and "lift" for a cup where it stands."""
    position = world.object(spec.name).pose.position
    return grasping.solve_chain(position[:2], height=float(position[2]))


def _taking(chain: dict[str, Array], looks: int) -> tuple[Move, ...]:
    return (
        Move("approach", chain["approach"], looks, AROUND_APPROACH, elsewhere=BEFORE_APPROACH),
        Move("grasp", chain["grasp"], 2, AROUND_GRASP, action="close_gripper"),
    )


def _raised(joints: Array, height: float) -> Array:
    pose = kinematics.forward(joints)
    pose[2, 3] += height
    return pouring.solve(pose, joints)


def _two_areas(seed: int, purpose: Purpose, count: int) -> tuple[tuple[Place, ...], ...]:
    return draw_in((CUPS_AREA, JARS_AREA), seed, purpose, count)
