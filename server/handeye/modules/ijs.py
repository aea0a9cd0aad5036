"""IJS, image to joints: the module that replaces CSS, CAS and AJS in the thesis's real experiments (4.2, 4.2.5).

Inputs: the subtask, the vector from hand to object in the stereo image, the joints. Outputs: how far each joint is to
turn.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from handeye.modules.declaration import ApproximatorSettings, Component, ModuleDeclaration, Output
from handeye.modules.spaces import HandVector, ImageVector, JointAngles

JOINTS = 6

# Ten demonstrations in a 30 x 30 cm area are few and far apart. What carries from one place to the next is the smooth
# change of the whole map, so the best answers come from a fit to all samples of a subtask, the near ones weighing more.
APPROXIMATORS = {
    settings.method: settings
    for settings in (
        ApproximatorSettings(method="local_quadratic", neighbours=None, ridge=1e-5, curvature_ridge=3e-3),
        ApproximatorSettings(method="local_linear", neighbours=60, ridge=1e-2),
        ApproximatorSettings(method="kndb2", neighbours=40, ridge=1e-3),
        ApproximatorSettings(method="kndb", neighbours=5),
        ApproximatorSettings(method="nearest", neighbours=1),
    )
}
"""Settings that suit IJS, by method; the thesis used `kndb`."""

DECLARATION = ModuleDeclaration(
    name="IJS",
    inputs=(
        Component(name="subtask", unit="", categorical=True),
        # A pixel of disparity is worth about three times as many millimetres as one of row or column.
        Component(name="delta row", unit="px", scale=30.0),
        Component(name="delta column", unit="px", scale=30.0),
        Component(name="delta disparity", unit="px", scale=10.0),
        *(Component(name=f"joint {i}", unit="rad", scale=0.15) for i in range(1, JOINTS + 1)),
    ),
    outputs=tuple(Output(name=f"delta joint {i}", unit="rad") for i in range(1, JOINTS + 1)),
    approximator=APPROXIMATORS["local_quadratic"],
)

IN_HAND = ModuleDeclaration(
    name="IJS",
    inputs=(
        Component(name="subtask", unit="", categorical=True),
        *(Component(name=axis, unit="m", scale=0.05) for axis in ("right", "up", "out")),
        # The way alone says nearly all; joints tell what the arm is like there (docs/decisions/021).
        *(Component(name=f"joint {i}", unit="rad", scale=2.0) for i in range(1, JOINTS + 1)),
    ),
    outputs=DECLARATION.outputs,
    approximator=ApproximatorSettings(method="local_quadratic", neighbours=None, ridge=1e-3, curvature_ridge=1e-2),
)
"""The same with the way from hand to object in the hand's own axes."""


def input_vector(subtask: int, vector: ImageVector | HandVector, joints: JointAngles) -> NDArray[np.float64]:
    """IJS's input, shape (10,): the number of the subtask, the vector from hand to object, the joints."""
    return np.concatenate([[float(subtask)], vector.array(), joints.array()])
