"""Where cups stand: random places in the workspace, drawn apart for teaching and for testing."""

from __future__ import annotations

import math
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
    random = generator(seed, purpose)
    low = WORKSPACE_CENTRE - size / 2
    places = []
    for _ in range(count):
        x, y = low + size * random.random(2)
        places.append(Place(float(x), float(y), float(random.uniform(-math.pi, math.pi)), int(random.integers(2**31))))
    return tuple(places)
