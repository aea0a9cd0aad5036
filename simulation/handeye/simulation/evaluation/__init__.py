"""`handeye evaluate`: the hand-eye system's figures, each measured on a lab of its own, from a seed.

The acting side has images and encoders. Truth, which the referee here has, only judges.
"""

from handeye.simulation.evaluation import (
    foretelling,
    pour,
    pursuit,
    reaching,
    resilience,
    saccade,
    stack,
    stereo,
    vision,
)
from handeye.simulation.evaluation.grasp import CLUMSY_TEACHER, GRASP, WIDE
from handeye.simulation.evaluation.site import Evaluation

EVALUATIONS: dict[str, Evaluation] = {
    each.name: each
    for each in (
        stereo.EVALUATION,
        saccade.EVALUATION,
        pursuit.EVALUATION,
        reaching.EVALUATION,
        GRASP,
        CLUMSY_TEACHER,
        WIDE,
        resilience.EVALUATION,
        foretelling.EVALUATION,
        pour.EVALUATION,
        stack.EVALUATION,
        vision.EVALUATION,
    )
}
"""By name."""

__all__ = ["EVALUATIONS"]
