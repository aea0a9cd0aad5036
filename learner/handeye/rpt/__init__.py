"""The learner: a Recursive Partition Tree and the functions that make answers of the samples it retrieves.

Needs no robot and nothing else of this project (thesis 3.2 and 3.3). `Model` is what most users want; `Tree` the search
alone; `RPTRegressor` the scikit-learn estimator; `handeye.rpt.mdf` has the tree for images.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from handeye.rpt import approximate
from handeye.rpt.answers import Answer
from handeye.rpt.calibration import Calibration
from handeye.rpt.model import Model, NotTaught, RegionStatistics
from handeye.rpt.radii import derive_radii
from handeye.rpt.settings import Settings
from handeye.rpt.structure import Nodes, Statistics
from handeye.rpt.tree import Neighbours, Tree, build

if TYPE_CHECKING:
    from handeye.rpt.estimator import RPTRegressor

__all__ = [
    "Answer",
    "Calibration",
    "Model",
    "Neighbours",
    "Nodes",
    "NotTaught",
    "RPTRegressor",
    "RegionStatistics",
    "Settings",
    "Statistics",
    "Tree",
    "approximate",
    "build",
    "derive_radii",
]


def __getattr__(name: str) -> Any:
    """Imports the estimator when it is asked for: it needs scikit-learn, which the learner itself does not."""
    if name == "RPTRegressor":
        from handeye.rpt.estimator import RPTRegressor

        return RPTRegressor
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
