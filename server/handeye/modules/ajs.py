"""AJS, arm to joints: from the point where the arm is to be, and its joints now, to how far each joint is to turn.

Ours takes the joints too, which the thesis's does not (4.1.3): so an answer is the way from here, and any two postures
that were ever visited make a sample. The answer changes with the joints like the joints themselves, which a large scale
leaves to the linear part; what has to be learned near by near is the place.
"""

from __future__ import annotations

import numpy as np

from handeye.modules.declaration import ApproximatorSettings, Component, ModuleDeclaration, Output
from handeye.modules.ijs import JOINTS
from handeye.modules.spaces import ArmPoint, Floats, JointAngles

DECLARATION = ModuleDeclaration(
    name="AJS",
    inputs=(
        *(Component(name=axis, unit="m", scale=0.1) for axis in "xyz"),
        *(Component(name=f"joint {i}", unit="rad", scale=3.0) for i in range(1, JOINTS + 1)),
    ),
    outputs=tuple(Output(name=f"delta joint {i}", unit="rad") for i in range(1, JOINTS + 1)),
    approximator=ApproximatorSettings(method="local_quadratic", neighbours=60, ridge=1e-6, curvature_ridge=0.1),
)


def input_vector(point: ArmPoint, joints: JointAngles) -> Floats:
    """AJS's input, shape (9,): where the arm's point is to be, and the joints now."""
    return np.concatenate([point.array(), joints.array()])
