"""SCS, sensor control: from a point in the stereo image to the turn of the head that centres it in the left picture.

Ours knows the head's tilt and answers with a turn, so it works from any pose of the head; the thesis's answers with the
pose itself, for a head that always begins at the same one (4.2.4). Pan needs not be known: the head looks the same
from all around its own axis.
"""

from __future__ import annotations

import numpy as np

from handeye.modules.declaration import ApproximatorSettings, Component, ModuleDeclaration, Output
from handeye.modules.spaces import Floats, ImagePoint

DECLARATION = ModuleDeclaration(
    name="SCS",
    inputs=(
        Component(name="row", unit="px", scale=150.0),
        Component(name="column", unit="px", scale=150.0),
        # The left camera stands beside the pan axis: how far beside, in view, changes slowly with the depth.
        Component(name="disparity", unit="px", scale=1000.0),
        Component(name="tilt", unit="rad", scale=0.4),
    ),
    outputs=(Output(name="delta pan", unit="rad"), Output(name="delta tilt", unit="rad")),
    approximator=ApproximatorSettings(
        method="local_quadratic", neighbours=20, smoothing=0.03, ridge=1e-4, curvature_ridge=1e-2
    ),
)


def input_vector(point: ImagePoint, tilt: float) -> Floats:
    """SCS's input, shape (4,): the point in the stereo image, and the head's tilt in rad."""
    return np.concatenate([point.array(), [tilt]])
