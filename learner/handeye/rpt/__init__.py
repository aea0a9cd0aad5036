"""The learner: a Recursive Partition Tree and the functions that make answers of the samples it retrieves.

Needs no robot and nothing else of this project (thesis 3.2 and 3.3). `tree` builds and searches, `approximate`
interpolates, `kernels` holds the compiled loops.
"""

from handeye.rpt import approximate
from handeye.rpt.tree import Neighbours, Statistics, Tree, build, derive_radii, query_beam, query_exact, statistics

__all__ = [
    "Neighbours",
    "Statistics",
    "Tree",
    "approximate",
    "build",
    "derive_radii",
    "query_beam",
    "query_exact",
    "statistics",
]
