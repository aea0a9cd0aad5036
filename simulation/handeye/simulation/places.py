"""Where cups stand: random places in the workspace, drawn apart for teaching and for testing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from handeye.simulation.scene import WORKSPACE_CENTRE, WORKSPACE_SIZE


@dataclass(frozen=True, slots=True)
class Place:
    """Where an object stands: (x, y) in m, world frame; its yaw in rad; and the seed of the world that it stands in."""

    x: float
    y: float
    yaw: float
    seed: int


@dataclass(frozen=True, slots=True)
class Area:
    """A square on the table: its centre (x, y) and the length of its sides, in m."""

    centre: tuple[float, float]
    size: float


class Purpose(IntEnum):
    """What places are drawn for. Each purpose has random numbers of its own, so none can leak into another."""

    TEACHING = 1
    TESTING = 2
    MOTIONS = 3


def generator(seed: int, purpose: Purpose) -> np.random.Generator:
    """Random numbers of one purpose under the user's `seed`."""
    return np.random.default_rng([seed, int(purpose)])


def draw(seed: int, purpose: Purpose, count: int, size: float = WORKSPACE_SIZE) -> tuple[Place, ...]:
    """`count` places, uniform over a square around the workspace's centre with edge `size`, in m.

    The first n are the same for every `count` ≥ n.
    """
    workspace = Area((float(WORKSPACE_CENTRE[0]), float(WORKSPACE_CENTRE[1])), size)
    return tuple(place for (place,) in draw_in((workspace,), seed, purpose, count))


def draw_in(areas: Sequence[Area], seed: int, purpose: Purpose, count: int) -> tuple[tuple[Place, ...], ...]:
    """`count` times a place in each of the areas; the first n are the same for every `count` ≥ n."""
    random = generator(seed, purpose)
    return tuple(tuple(_place(area, random) for area in areas) for _ in range(count))


def _place(area: Area, random: np.random.Generator) -> Place:
    x, y = np.array(area.centre) - area.size / 2 + area.size * random.random(2)
    return Place(float(x), float(y), float(random.uniform(-math.pi, math.pi)), int(random.integers(2**31)))
