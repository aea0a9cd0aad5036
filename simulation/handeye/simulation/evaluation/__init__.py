"""`handeye evaluate`: the hand-eye system's figures, each measured on a lab of its own, from a seed.

The acting side has images and encoders. Truth, which the referee here has, only judges.
"""

from handeye.simulation.evaluation import pursuit, reaching, saccade, stereo
from handeye.simulation.evaluation.site import Evaluation

EVALUATIONS: dict[str, Evaluation] = {
    each.EVALUATION.name: each.EVALUATION for each in (stereo, saccade, pursuit, reaching)
}
"""By name."""

__all__ = ["EVALUATIONS"]
