"""CSS, camera-centred stereo: from a point in the stereo image to one in the left camera's frame (thesis 4.1.1, 4.2.3).

The map is that of two lenses, smooth and strongly curved in disparity: a local polynomial of degree 2 follows it to
tenths of a millimetre where the thesis's weighted neighbours stay at millimetres. Samples come in planes, the views of
a grid; neighbours from one plane say nothing about the way out of it, so many are asked.
"""

from __future__ import annotations

from handeye.modules.declaration import ApproximatorSettings, Component, ModuleDeclaration, Output

DECLARATION = ModuleDeclaration(
    name="CSS",
    inputs=(
        Component(name="row", unit="px", scale=60.0),
        Component(name="column", unit="px", scale=60.0),
        Component(name="disparity", unit="px", scale=10.0),
    ),
    outputs=tuple(Output(name=axis, unit="m") for axis in "xyz"),
    approximator=ApproximatorSettings(method="local_quadratic", neighbours=60, ridge=1e-5, curvature_ridge=1e-4),
)
