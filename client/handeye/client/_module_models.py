"""Modules: what they declare, what they were taught, what was learned from it."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from pydantic import ConfigDict

from handeye.client._model import Model, PageModel


class Declared(Model):
    """Part of a declaration. Keys that this version does not know are kept: a declaration read can be sent again."""

    model_config = ConfigDict(extra="allow", frozen=True)


class Component(Declared):
    """An input: differences of `scale`, in `unit`, count alike across inputs; a category has to match exactly."""

    name: str
    unit: str = ""
    scale: float = 1.0
    categorical: bool = False


class Output(Declared):
    """An output and its unit."""

    name: str
    unit: str = ""


class Declaration(Declared):
    """A module: a map from `inputs` to `outputs`, learned from examples; no `approximator`: the coordinator's own."""

    name: str
    inputs: tuple[Component, ...]
    outputs: tuple[Output, ...]
    approximator: dict[str, Any] | None = None


class ModuleInfo(Model):
    """A module: its declaration, and how many samples and demonstrations it was taught."""

    name: str
    declaration: Declaration
    samples: int
    demonstrations: int
    created: datetime


class Modules(PageModel):
    """The modules."""

    modules: tuple[ModuleInfo, ...]


class Sample(Model):
    """A taught sample, in the declared order and units; `demonstration`: where it came from, if from any."""

    number: int
    input: tuple[float, ...]
    output: tuple[float, ...]
    demonstration: str | None


class SamplesPage(PageModel):
    """Samples, by their numbers."""

    samples: tuple[Sample, ...]


class SamplesAdded(Model):
    """Samples that are kept, numbered from `first` on; `samples`: how many the module has now."""

    first: int
    count: int
    samples: int


class CategoryStatistics(Model):
    """What was learned for one combination of categories.

    Half of the samples lie closer than `median_reach` to a sample of another demonstration and all of them closer than
    `largest_reach`, in scaled units: there a query's support is 1/2.
    """

    category: tuple[float, ...]
    samples: int
    demonstrations: int
    nodes: int
    levels: int
    median_reach: float
    largest_reach: float


class ModuleStatistics(Model):
    """What was learned, by category."""

    module: str
    samples: int
    categories: tuple[CategoryStatistics, ...]


class TreeNode(Model):
    """A node of a module's tree: its parent's number, its level, how many children it has and samples it keeps.

    `point` is the input it stands for, in the declared units; node 0 is the root and stands for none.
    """

    number: int
    parent: int | None
    level: int
    children: int
    samples: int
    point: tuple[float, ...] | None


class Tree(Model):
    """A module's tree for one category, breadth first: the nodes, and the radius of each level in scaled units.

    `components` are the names of the points' numbers; `truncated`: there are more nodes than are told.
    """

    components: tuple[str, ...]
    radii: tuple[float, ...]
    nodes: tuple[TreeNode, ...]
    truncated: bool


class Snapshot(Model):
    """A module's samples and declaration as they were."""

    name: str
    created: datetime
    samples: int


class Snapshots(Model):
    """A module's snapshots, oldest first."""

    snapshots: tuple[Snapshot, ...]


class Removed(Model):
    """How many samples were removed."""

    removed: int
