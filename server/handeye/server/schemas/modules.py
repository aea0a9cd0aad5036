"""The bodies of modules: their declarations, trees and snapshots."""

from __future__ import annotations

from datetime import datetime

from handeye.modules.declaration import ApproximatorSettings, ModuleDeclaration
from handeye.server.schemas.base import Body, ModuleName, Name


class ModuleInfo(Body):
    """A module: what it is, and how much it was taught."""

    name: str
    declaration: ModuleDeclaration
    samples: int
    demonstrations: int
    """From how many demonstrations the samples came."""
    created: datetime


class NewModule(ModuleDeclaration):
    """A module to be."""

    name: ModuleName


class ModulePage(Body):
    """Modules, by name."""

    modules: tuple[ModuleInfo, ...]
    next: str | None
    """The cursor of the next page; null at the end."""


class RetrainRequest(Body):
    """How the module is to answer from now on; null: as before."""

    approximator: ApproximatorSettings | None = None


class TreeNode(Body):
    """A node of a tree; node 0 is the root, which holds no point."""

    number: int
    parent: int | None
    level: int
    children: int
    samples: int
    """That a leaf keeps."""
    point: tuple[float, ...] | None
    """The input it stands for, in the declared units."""


class TreeInfo(Body):
    """A module's tree, breadth first."""

    components: tuple[str, ...]
    """What the points' numbers are."""
    radii: tuple[float, ...]
    """T(1) > T(2) > ..., in scaled units."""
    nodes: tuple[TreeNode, ...]
    truncated: bool
    """There are more nodes."""


class SnapshotRequest(Body):
    """What to call it."""

    name: Name


class SnapshotInfo(Body):
    """A module as it was at one moment."""

    name: str
    samples: int
    created: datetime


class SnapshotList(Body):
    """A module's snapshots, oldest first."""

    snapshots: tuple[SnapshotInfo, ...]
