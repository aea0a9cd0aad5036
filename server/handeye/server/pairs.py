"""Training pairs of module IJS: what was shown in demonstrations, and what they imply."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from handeye.modules import asm, ijs
from handeye.modules.module import Module
from handeye.modules.spaces import HandVector, ImageVector, JointAngles
from handeye.server.demonstration import Demonstration, Observation, Subtask
from handeye.server.problem import Conflict

_PARTNERS = 4
"""Of each look of a single demonstration; of several demonstrations they are shared among these."""


class NotTeachable(Conflict):
    """The demonstrations do not make a task."""

    code = "not_teachable"


@dataclass(frozen=True, slots=True)
class Pairs:
    """Training pairs of module IJS: inputs (n, 10), outputs (n, joints), and the demonstration of each."""

    inputs: NDArray[np.float64]
    outputs: NDArray[np.float64]
    demonstrations: tuple[str, ...]


class _Pair(NamedTuple):
    code: int
    action: ImageVector | HandVector
    joints: NDArray[np.float64]
    turn: NDArray[np.float64]


def waypoint_codes(order: Sequence[Subtask]) -> dict[str, range]:
    """The action codes of each subtask's way-points; those of the goals are the subtasks' numbers, and come before."""
    codes, following = {}, len(order)
    for subtask in order:
        codes[subtask.name] = range(following, following + len(subtask.way))
        following += len(subtask.way)
    return codes


def pairs(
    demonstrations: Sequence[Demonstration], order: Sequence[Subtask], css: Module | None = None, *, key_only: bool
) -> Pairs:
    """Every look towards its subtask's goal and way-points in the same demonstration.

    Input: (action code, vector hand -> object, joints); output: joints there - joints of the look. The code of a goal
    is the subtask's number, those of way-points are `waypoint_codes`. With `key_only` only the looks marked as the
    thesis's bare pairs.

    When `css` is given the vector is in the hand's own axes, and what the demonstrations imply is added: had the object
    stood as it has to, at a goal, for where the hand was in some other look, then that would have been the goal.
    """
    numbers = {subtask.name: number for number, subtask in enumerate(order)}
    codes = waypoint_codes(order)
    found: list[tuple[str, _Pair]] = []
    for demonstration in demonstrations:
        seen = _metric(demonstration, css)
        found += [(demonstration.id, pair) for pair in _shown(demonstration, numbers, codes, seen, key_only=key_only)]
        if not key_only:
            partners = -(-_PARTNERS // len(demonstrations))
            found += [(demonstration.id, pair) for pair in _implied(demonstration, numbers, seen, partners)]
    if without := set(numbers.values()) - {pair.code for _, pair in found}:
        names = ", ".join(f"'{order[number].name}'" for number in sorted(without))
        raise NotTeachable(f'There is no pair to train {names} from: no observation there is marked with "key".')
    return Pairs(
        np.array([ijs.input_vector(pair.code, pair.action, JointAngles(pair.joints)) for _, pair in found]),
        np.array([pair.turn for _, pair in found]),
        tuple(name for name, _ in found),
    )


def _metric(demonstration: Demonstration, css: Module | None) -> dict[int, asm.Metric]:
    """The looks by their numbers, in m; none without CSS."""
    if css is None:
        return {}
    return {look.number: asm.metric(css, look.found) for look in demonstration.observations if look.found is not None}


def _shown(
    demonstration: Demonstration,
    numbers: dict[str, int],
    codes: dict[str, range],
    seen: dict[int, asm.Metric],
    *,
    key_only: bool,
) -> Iterator[_Pair]:
    ends = {
        name: [(numbers[name], demonstration.goal(name)), *zip(codes[name], demonstration.way(name), strict=True)]
        for name in numbers
    }
    for look in demonstration.observations:
        if look.found is None or (key_only and not look.key):
            continue
        action = seen[look.number].way if seen else asm.in_picture(look.found)
        for code, end in ends[look.subtask]:
            if end is not None:  # finished demonstrations have all their goals
                yield _Pair(code, action, look.joints, end.joints - look.joints)


def _implied(
    demonstration: Demonstration, numbers: dict[str, int], seen: dict[int, asm.Metric], partners: int
) -> Iterator[_Pair]:
    """From each look towards itself and so many others; of all looks, whatever they were made for.

    The head must not have turned in between: the looks' frames have to be the same. Nothing is implied of an object in
    the grip: it stands nowhere else.
    """
    goals = {name: demonstration.goal(name) for name in _towards_what_stands(demonstration)}
    for looks in _by_head(demonstration, seen):
        apart = max(1, len(looks) // (partners + 1))
        for name, goal in goals.items():
            if goal is None:
                continue
            way = seen[goal.number].way
            for place, start in enumerate(looks):
                for partner in range(min(partners + 1, len(looks))):
                    there = looks[(place + partner * apart) % len(looks)]
                    point = seen[there.number].at_end_of(way)
                    yield _Pair(numbers[name], seen[start.number].to(point), start.joints, there.joints - start.joints)


def _towards_what_stands(demonstration: Demonstration) -> Iterator[str]:
    """The subtasks that are not towards what the gripper holds."""
    held = None
    for subtask in demonstration.subtasks:
        towards = demonstration.towards(subtask.name)
        if towards != held:
            yield subtask.name
        if subtask.action is not None:
            held = towards if subtask.action == "close_gripper" else None


def _by_head(demonstration: Demonstration, seen: dict[int, asm.Metric]) -> list[list[Observation]]:
    """The looks that are known in m, those together that were made with the head at rest in one direction."""
    directions: dict[tuple[float, float], list[Observation]] = {}
    for look in demonstration.observations:
        if look.number in seen and look.head is not None:
            directions.setdefault((look.head.pan, look.head.tilt), []).append(look)
    return list(directions.values())
