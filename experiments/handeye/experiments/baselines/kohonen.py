"""The Kohonen map with local linear maps: hand-eye coordination as Martinetz, Ritter and Schulten learned it.

Source: T. Martinetz, H. Ritter, K. Schulten, "Three-dimensional neural net for learning visuomotor coordination of a
robot arm", IEEE Transactions on Neural Networks 1 (1990) 131-136; thesis 2.4.6, eq 2.1, and 2.5.3.
"""

from __future__ import annotations

import numpy as np

from handeye.experiments.baselines.base import Floats
from handeye.experiments.baselines.kernels import kohonen_pass
from handeye.experiments.baselines.local_linear_maps import Ends, Integers, LocalLinearMaps

LATTICE_DIMENSIONS = 3
"""As in the paper, where the arm's workspace has three; with fewer inputs, as many as these."""


class KohonenRegressor(LocalLinearMaps):
    """Kohonen map with local linear maps; neighbours are those on a cubic lattice, its width counted in hops.

    Parameters and attributes are those of `LocalLinearMaps`; also hops_: (m, m) squared distances on the lattice.
    """

    def _arrange(self, neurons: int, dimension: int) -> tuple[int, float]:
        dimensions = min(dimension, LATTICE_DIMENSIONS)
        side = max(1, round(neurons ** (1 / dimensions)))
        places = np.indices((side,) * dimensions).reshape(dimensions, -1).T
        self.hops_ = ((places[:, np.newaxis] - places) ** 2).sum(axis=-1).astype(np.float64)
        return len(places), side / 2

    def _present(
        self, inputs: Floats, outputs: Floats, order: Integers, span: Ends, widths: Ends, rates: Ends, blur: float
    ) -> float:
        maps = self.references_, self.outputs_, self.jacobians_
        return float(kohonen_pass(inputs, outputs, order, span, self.hops_, widths, rates, blur, *maps))
