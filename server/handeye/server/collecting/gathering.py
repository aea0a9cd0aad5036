"""Where collected samples go, and the tally of what was collected and what was rejected."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from numpy.typing import ArrayLike

from handeye.modules.declaration import ModuleDeclaration
from handeye.server.job import Job
from handeye.server.livemodules import LiveModules
from handeye.server.problem import Conflict, NotFound
from handeye.server.results import CollectResult


class Gathering:
    """Writes samples into modules as they come: what was collected stays when the collecting ends early."""

    def __init__(self, modules: LiveModules, declarations: tuple[ModuleDeclaration, ...]) -> None:
        """Modules that are not there yet are made. `Conflict` when one of that name has other inputs or outputs."""
        self._modules = modules
        self._added: Counter[str] = Counter({declaration.name: 0 for declaration in declarations})
        self._rejected: Counter[str] = Counter()
        for declaration in declarations:
            require(modules, declaration)

    def add(self, module: str, inputs: ArrayLike, outputs: ArrayLike, origin: list[str | None]) -> None:
        """Teaches a module samples (n, N), (n, M) that came from `origin`, n names; they are durable then."""
        self._modules.add(module, inputs, outputs, origin)
        self._added[module] += len(origin)

    def reject(self, reason: str) -> None:
        """Counts what was not written down, and why."""
        self._rejected[reason] += 1

    def origins(self, module: str, prefix: str) -> int:
        """The highest number among the module's origins called `prefix`-<number>; 0 for none."""
        numbers = [
            int(number)
            for name in self._modules.demonstrations(module)
            if (number := name.removeprefix(f"{prefix}-")) != name and number.isdecimal()
        ]
        return max(numbers, default=0)

    @contextmanager
    def told_to(self, job: Job) -> Iterator[None]:
        """However what is done inside ends, the job's result says what was collected and rejected."""
        try:
            yield
        finally:
            job.finish(self.result)

    @property
    def result(self) -> CollectResult:
        """So far."""
        return CollectResult(added=dict(self._added), rejected=dict(self._rejected))


def require(modules: LiveModules, declaration: ModuleDeclaration) -> None:
    """Makes the declared module unless it is there; `Conflict` when one of that name has other inputs or outputs."""
    try:
        known = modules.stored(declaration.name).declaration
    except NotFound:
        modules.create(declaration)
        return
    if (known.inputs, known.outputs) != (declaration.inputs, declaration.outputs):
        raise Conflict(
            f"Module '{declaration.name}' has other inputs or outputs than what is collected; delete it by "
            f"DELETE /v1/modules/{declaration.name}, or rename it by export and import."
        )
