"""How far from ideal the laboratory is: `Profile.named("default")` as real rigs are, `"ideal"` without any error."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

ProfileName = Literal["default", "ideal"]


@dataclass(frozen=True, slots=True)
class Profile:
    """The non-ideal effects of robot, head and cameras.

    Attributes:
        name: what `Profile.named` knows it by.
        backlash: whole play between motor and link of every joint, in rad.
        encoder: the encoders count in steps (see `puma.ENCODER_STEP`); False reads exactly.
        pixel_noise: standard deviation of the cameras' noise, in grey levels of 255.
        k1: first radial distortion coefficient of both lenses (of the squared normalised radius).
        k2: second radial distortion coefficient of both lenses.
        latency: world time from a picture's exposure to the moment it can be read, in s.
        skew: world time from the left exposure to the right one, in s.
        head_step: the pan/tilt unit moves in multiples of this angle, in rad; 0 moves exactly.
    """

    name: ProfileName
    backlash: float
    encoder: bool
    pixel_noise: float
    k1: float
    k2: float
    latency: float
    skew: float
    head_step: float

    @classmethod
    def named(cls, name: str) -> Profile:
        """The profile of that name; `ValueError` names the known ones."""
        try:
            return _PROFILES[name]
        except KeyError:
            raise ValueError(f"unknown profile {name!r}; known are {', '.join(_PROFILES)}") from None


_PROFILES: dict[str, Profile] = {
    "default": Profile(
        name="default",
        backlash=math.radians(0.1),
        encoder=True,
        pixel_noise=2.0,
        k1=-0.08,
        k2=0.01,
        latency=0.05,
        skew=0.004,
        # Directed Perception PTU-46: 185.1428 arc seconds a step.
        head_step=math.radians(185.1428 / 3600),
    ),
    "ideal": Profile(
        name="ideal",
        backlash=0.0,
        encoder=False,
        pixel_noise=0.0,
        k1=0.0,
        k2=0.0,
        latency=0.0,
        skew=0.0,
        head_step=0.0,
    ),
}
