"""Modules, the thesis's shell processes: what the learner's numbers mean on the way from pictures to joints.

`pipeline` is the page to read first; `spaces` are the stations on the way; `declaration` and `module` say what a module
is and make one; `ijs` declares the module from image to joints; `recognition` finds object and hand in two pictures.
"""

from handeye.modules.answers import Answer, Answers, Neighbour, Support
from handeye.modules.declaration import ApproximatorSettings, Component, ModuleDeclaration, Output
from handeye.modules.module import Module, warm_up
from handeye.modules.spaces import ImagePair, ImagePoint, ImageVector, JointAngles, JointDifference
from handeye.rpt import NotTaught

__all__ = [
    "Answer",
    "Answers",
    "ApproximatorSettings",
    "Component",
    "ImagePair",
    "ImagePoint",
    "ImageVector",
    "JointAngles",
    "JointDifference",
    "Module",
    "ModuleDeclaration",
    "Neighbour",
    "NotTaught",
    "Output",
    "Support",
    "warm_up",
]
