"""What goes wrong after the teaching: the object is moved, it slips, joints read wrong, the head was bumped, the
gripper is half hidden. The task ends well, or it says why it does not; it never says that it did when it did not."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from handeye.robot_bridge.driver import unwatched
from handeye.rpc.errors import InvalidArgument
from handeye.simulation import grasping, gripper, kinematics, rig
from handeye.simulation.collecting import collect
from handeye.simulation.conditions import Conditions
from handeye.simulation.evaluation.grasp import CUP, show, told
from handeye.simulation.evaluation.outcome import Figure, count, share
from handeye.simulation.evaluation.site import Evaluation, Site, Trial
from handeye.simulation.lessons import grasp
from handeye.simulation.objects import GRID
from handeye.simulation.places import Place, Purpose, draw
from handeye.simulation.pose import Pose
from handeye.simulation.report import Picture
from handeye.simulation.teacher import Teacher
from handeye.simulation.trying import Judged, Trials

_TASK = "grasp"
_TAUGHT = 10
_PUSH = (0.01, 0.05)  # m
_SLIP = (0.1, 1.5)  # s
_OFFSET = math.radians(1.0)
_BUMP = math.radians(2.0)
_CARD = replace(GRID, name="card", radius=0.05)
_CARD_AT = 0.5  # of the way from the left camera to the hand
_ASIDE = math.radians(60.0)
_TRIES = 20

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Mischance:
    """One kind of thing that goes wrong."""

    name: str
    conditions: Callable[[np.random.Generator], Conditions]
    hides: bool = False
    """A card hides half of the gripper from the left camera, where it comes to grasp."""


def _pushed(random: np.random.Generator) -> Conditions:
    angle, way = random.uniform(0.0, 2 * math.pi), random.uniform(*_PUSH)
    return Conditions(push=(way * math.cos(angle), way * math.sin(angle)))


def _slipped(random: np.random.Generator) -> Conditions:
    return Conditions(slip=random.uniform(*_SLIP))


def _offset(random: np.random.Generator) -> Conditions:
    offsets = np.zeros(6)
    offsets[random.choice(6, 2, replace=False)] = random.choice((-_OFFSET, _OFFSET), 2)
    return Conditions(joint_offsets=tuple(offsets.tolist()))


def _bumped(random: np.random.Generator) -> Conditions:
    angle = random.uniform(0.0, 2 * math.pi)
    return Conditions(head_bump=(_BUMP * math.cos(angle), _BUMP * math.sin(angle)))


MISCHANCES = (
    Mischance("object pushed 1 to 5 cm after the approach", _pushed),
    Mischance("cup slips for 0.1 to 1.5 s", _slipped),
    Mischance("two joints read 1° wrong", _offset),
    Mischance("head bumped by 2°", _bumped),
    Mischance("gripper half hidden from the left camera", lambda _random: Conditions(), hides=True),
)


def _measure(site: Site, seed: int, trials: int, pictures: list[Picture]) -> list[Trial]:
    """Lets CSS be taught, and teaches ten demonstrations, with all in order; then tries each kind of mischance."""
    collect("CSS", site.lab, site.client, seed, site.progress)
    teacher = Teacher(site.robot, site.lab, site.client, grasp(CUP), _TASK, unwatched)
    teacher.register_objects(seed)
    show(site, teacher, seed, _TAUGHT, "teaching")
    site.client.train(_TASK)
    found: list[Trial] = []
    for kind, mischance in enumerate(MISCHANCES):
        judged = _tried(site, mischance, draw(seed, Purpose.TESTING, trials), np.random.default_rng([seed, 10 + kind]))
        found += [{"mischance": mischance.name, **told(each), "well": _ended_well(each)} for each in judged]
        frame = site.client.frame("left")
        pictures.append(Picture(frame, f"{mischance.name}, seed {seed}: the left picture at the last trial's end."))
    return found


def _tried(site: Site, mischance: Mischance, places: Sequence[Place], random: np.random.Generator) -> list[Judged]:
    trying = Trials(site.client, site.lab, CUP, _TASK, site.stack.check)
    before = partial(_hide, site, random) if mischance.hides else None
    found = []
    with site.progress(mischance.name, len(places)) as advance:
        for number, place in enumerate(places, start=1):
            found.append(trying.at(number, place, conditions=mischance.conditions(random), before=before))
            advance()
    return found


def _ended_well(judged: Judged) -> bool:
    """The cup is held up in the air. How far it was pushed before is not the arm's doing where others push it."""
    return judged.trial.passed["grasp"] and judged.trial.passed["lift"]


def _hide(site: Site, random: np.random.Generator, place: Place) -> None:
    """Holds a card before the left camera: its edge runs through the middle of the marker where the hand grasps.

    It comes from a side on which the object is not: it is the gripper that is hidden.
    """
    hand = kinematics.forward(grasping.solve_chain(np.array([place.x, place.y]))["grasp"])
    marker = gripper.marker_place(hand)
    camera = np.linalg.inv(rig.left_from_world(*rig.rig().head.home))
    axes = camera[:3, :3]
    away = axes.T @ (marker - hand[:3, 3])
    for _ in range(_TRIES):
        angle = math.atan2(away[1], away[0]) + random.uniform(-_ASIDE, _ASIDE)
        aside = axes @ np.array([math.cos(angle), math.sin(angle), 0.0]) * _CARD.radius
        pose = np.eye(4)
        pose[:3, :3] = axes @ np.diag([1.0, -1.0, -1.0])
        pose[:3, 3] = camera[:3, 3] + _CARD_AT * (marker - camera[:3, 3]) + aside
        try:
            site.lab.hold(_CARD, Pose.from_matrix(pose))
        except InvalidArgument:  # the arm is there
            continue
        return
    raise ValueError(f"there is no room for a card before the hand at ({place.x:.3f}, {place.y:.3f}) m")


def _figures(found: Sequence[Trial]) -> tuple[Figure, ...]:
    figures = []
    for mischance in MISCHANCES:
        tried = [each for each in found if each["mischance"] == mischance.name]
        figures += [
            share(mischance.name, [each["well"] for each in tried], 90.0),
            share(f"{mischance.name}: held, out of the taught region", [each["held"] for each in tried], most=8.0),
            share(
                f"{mischance.name}: failed otherwise and said why",
                [bool(each["failure"]) and not each["held"] for each in tried],
            ),
        ]
    unreported = sum(not each["well"] and not each["failure"] for each in found)
    return (*figures, count("failures that were not reported", unreported, len(found), 0))


EVALUATION = Evaluation("resilience", "What goes wrong after the teaching", _measure, _figures, lambda _found: {})
