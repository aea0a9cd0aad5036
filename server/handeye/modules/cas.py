"""CAS, camera to arm: from a point in the camera's frame and the head's angles to a point in the arm's frame (4.1.2).

Samples are places of the hand: where the cameras see it, and what the arm makes of its joint readings there.
"""

from __future__ import annotations

import numpy as np

from handeye.modules.declaration import ApproximatorSettings, Component, ModuleDeclaration, Output
from handeye.modules.spaces import CameraPoint, Floats, HeadAngles

DECLARATION = ModuleDeclaration(
    name="CAS",
    inputs=(
        *(Component(name=axis, unit="m", scale=0.1) for axis in "xyz"),
        Component(name="pan", unit="rad", scale=0.07),
        Component(name="tilt", unit="rad", scale=0.07),
    ),
    outputs=tuple(Output(name=axis, unit="m") for axis in "xyz"),
    approximator=ApproximatorSettings(method="local_quadratic", neighbours=60, ridge=1e-5, curvature_ridge=1e-3),
)


def input_vector(point: CameraPoint, head: HeadAngles) -> Floats:
    """CAS's input, shape (5,): the point in the camera's frame, pan, tilt."""
    return np.concatenate([point.array(), head.array()])
