"""Neural gas with local linear maps: the Kohonen map's successor in hand-eye coordination.

Sources: J. Walter, K. Schulten, "Implementation of self-organizing neural networks for visuo-motor control of an
industrial robot", IEEE Transactions on Neural Networks 4 (1993) 86-95; T. Martinetz, S. Berkovich, K. Schulten,
"Neural-gas network for vector quantization and its application to time-series prediction", ibid. 558-569; thesis 2.4.6.
"""

from __future__ import annotations

from handeye.experiments.baselines.base import Floats
from handeye.experiments.baselines.kernels import gas_pass
from handeye.experiments.baselines.local_linear_maps import Ends, Integers, LocalLinearMaps


class NeuralGasRegressor(LocalLinearMaps):
    """Neural gas with local linear maps; a neuron's share falls with its rank by distance from the sample.

    Parameters and attributes are those of `LocalLinearMaps`; the neighbourhood's width is counted in ranks.
    """

    def _arrange(self, neurons: int, dimension: int) -> tuple[int, float]:
        return neurons, neurons / 2

    def _present(
        self, inputs: Floats, outputs: Floats, order: Integers, span: Ends, widths: Ends, rates: Ends, blur: float
    ) -> float:
        maps = self.references_, self.outputs_, self.jacobians_
        return float(gas_pass(inputs, outputs, order, span, widths, rates, blur, *maps))
