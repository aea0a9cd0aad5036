"""What a module learned, for people: figures by category, and its tree for a drawing."""

from __future__ import annotations

from handeye.modules.module import Module
from handeye.rpt import NotTaught
from handeye.server.problem import NotFound
from handeye.server.results import CategoryInfo, ModuleStatistics
from handeye.server.schemas.modules import TreeInfo, TreeNode

MOST_NODES = 20_000
"""Nodes that a drawing is given, breadth first."""


def module_statistics(name: str, module: Module) -> ModuleStatistics:
    """What it learned, by category."""
    return ModuleStatistics(
        module=name,
        samples=module.samples,
        categories=tuple(
            CategoryInfo(
                category=each.category,
                samples=each.samples,
                demonstrations=each.demonstrations,
                nodes=each.tree.nodes,
                levels=each.tree.levels,
                median_reach=each.support.median,
                largest_reach=each.support.largest,
            )
            for each in module.statistics()
        ),
    )


def tree_of(name: str, module: Module, category: tuple[float, ...]) -> TreeInfo:
    """The tree of one category; `NotFound` when nothing was learned there."""
    try:
        tree = module.tree(category)
    except (NotTaught, KeyError) as error:
        raise NotFound(
            f"Module '{name}' has no tree for category {list(category)}; GET /v1/modules/{name}/statistics lists them."
        ) from error
    declared = [component for component in module.declaration.inputs if not component.categorical]
    scales = [component.scale for component in declared]
    nodes = tree.nodes()
    shown = min(len(nodes.sample), MOST_NODES)
    points = tree.points * scales
    return TreeInfo(
        components=tuple(component.name for component in declared),
        radii=tuple(tree.radii.tolist()),
        nodes=tuple(
            TreeNode(
                number=number,
                parent=None if number == 0 else int(nodes.parent[number]),
                level=int(nodes.level[number]),
                children=int(nodes.child_count[number]),
                samples=len(nodes.members[number]),
                point=None if number == 0 else tuple(points[nodes.sample[number]].tolist()),
            )
            for number in range(shown)
        ),
        truncated=shown < len(nodes.sample),
    )
