"""The modules that answer: in memory as trees, in the store as declarations and samples. The store is the truth."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import nullcontext

import numpy as np
import structlog
from numpy.typing import ArrayLike, NDArray
from sqlalchemy import Connection

from handeye.modules.answers import TaughtSamples
from handeye.modules.declaration import ApproximatorSettings, ModuleDeclaration
from handeye.modules.module import Module
from handeye.server.problem import Conflict, Invalid, NotFound, NotReady, sentence
from handeye.server.store import Store
from handeye.server.store import modules as stored
from handeye.server.store import tasks as stored_tasks
from handeye.server.store.modules import Snapshot, StoredModule

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Progress = Callable[[float], None]

_BUILDS = 3
"""Times that a module is built anew while samples come and go; then they have to wait."""

log = structlog.get_logger(__name__)


def _untold(_share: float) -> None:
    """The progress that nobody follows."""


class LiveModules:
    """The modules by name. What a method has returned from is durable, and the next query knows it.

    A write to the store and the same change in memory happen under the store's lock, so they never part. Queries wait
    for nothing. Safe among threads.
    """

    def __init__(self, store: Store) -> None:
        """`load` makes them answer."""
        self._store = store
        self._live: dict[str, Module | None] = {}
        """None: it could not be built from the store."""
        self._changes: Counter[str] = Counter()
        """How often each module has changed; counted before the next write begins."""
        self._loaded = threading.Event()

    def load(self, progress: Progress = _untold) -> None:
        """Builds all trees from the store; `progress` is told the share of samples done, 0..1."""
        with self._store.write() as connection:
            everything = stored.all_modules(connection)
            counts = [stored.count(connection, module.name) for module in everything]
            done, total = 0, max(sum(counts), 1)
            live: dict[str, Module | None] = {}
            for module, count in zip(everything, counts, strict=True):
                live[module.name] = self._rebuilt(module.name)
                done += count
                progress(done / total)

            def answer_by_them() -> None:
                self._live = live
                self._loaded.set()

            self._store.afterwards(answer_by_them)

    # Modules

    def create(self, declaration: ModuleDeclaration) -> StoredModule:
        """A module without samples; `Conflict` when there is one of that name."""
        with self._store.write() as connection:
            if stored.get(connection, declaration.name) is not None:
                raise Conflict(
                    f"There is a module '{declaration.name}' already; take another name, or delete it by "
                    f"DELETE /v1/modules/{declaration.name}."
                )
            module = Module(declaration)
            stored.create(connection, declaration)
            self._afterwards(declaration.name, module)
            return self.stored(declaration.name)

    def all(self) -> tuple[StoredModule, ...]:
        """By name."""
        with self._store.read() as connection:
            return stored.all_modules(connection)

    def stored(self, name: str, within: Connection | None = None) -> StoredModule:
        """What the store has of a module, `within` a transaction or a new one; `NotFound` when there is none."""
        with self._store.read() if within is None else nullcontext(within) as connection:
            module = stored.get(connection, name)
        if module is None:
            raise NotFound(f"There is no module '{name}'; declare it by POST /v1/modules.")
        return module

    def live(self, name: str) -> Module:
        """The module that answers; `NotFound` when there is none, `NotReady` when it is not built from the store."""
        module = self._live.get(name)
        if module is None:
            self._check_loaded()
            if name in self._live:
                raise NotReady(
                    f"Module '{name}' could not be built from the store, the log says why: take samples out, roll it "
                    "back, or train it with other settings."
                )
            raise NotFound(f"There is no module '{name}'; declare it by POST /v1/modules.")
        return module

    def _check_loaded(self) -> None:
        if not self._loaded.is_set():
            raise NotReady("The modules are still being built from the store; ask again in a moment.")

    def delete(self, name: str) -> None:
        """Deletes a module with its samples and snapshots; `Conflict` while a trained task answers by it."""
        with self._store.write() as connection:
            self.stored(name)
            if tasks := stored_tasks.of_module(connection, name):
                raise Conflict(
                    f"Task '{tasks[0]}' answers by module '{name}'; delete it by DELETE /v1/tasks/{tasks[0]}."
                )
            stored.drop(connection, name)

            def forget() -> None:
                self._changes[name] += 1
                self._live.pop(name, None)

            self._store.afterwards(forget)

    # Samples

    def add(self, name: str, inputs: ArrayLike, outputs: ArrayLike, demonstrations: Sequence[str | None]) -> int:
        """Adds samples (n, N), (n, M) and the demonstration of each; returns the first one's number.

        `Invalid` when they do not fit the declaration.
        """
        with self._store.write() as connection:
            try:
                rows, values = self.live(name).checked(inputs, outputs, demonstrations)
            except ValueError as error:
                raise Invalid(sentence(error)) from error
            first = stored.add_samples(connection, name, rows, values, demonstrations)

            def learn(module: Module) -> None:
                if module.learn(rows, values, demonstrations)[0] != first:
                    raise RuntimeError("samples have other numbers in memory than in the store")

            self._store.afterwards(lambda: self._follow(name, learn))
            return first

    def fill(self, name: str, samples: TaughtSamples) -> None:
        """Teaches a module many samples at once, in a new tree; raises as `add` does."""
        with self._store.write() as connection:
            module = self.stored(name)
            try:
                rows, values = Module(module.declaration).checked(
                    samples.inputs, samples.outputs, samples.demonstrations
                )
            except ValueError as error:
                raise Invalid(sentence(error)) from error
            stored.add_samples(connection, name, rows, values, samples.demonstrations)
            self._afterwards(name, self._built(name))

    def demonstrations(self, name: str) -> tuple[str, ...]:
        """The demonstrations that a module's samples came from, by name."""
        with self._store.read() as connection:
            return stored.demonstrations_of(connection, self.stored(name, connection).name)

    def samples(self, name: str, after: int, limit: int) -> list[TaughtSamples]:
        """The samples with numbers above `after`, at most `limit`, in pieces."""
        with self._store.read() as connection:
            return list(stored.read_samples(connection, self.stored(name, connection), after, limit))

    def remove(self, name: str, numbers: Sequence[int]) -> int:
        """Takes samples out; returns how many. `NotFound` names one that is not there, and then none is taken out."""
        with self._store.write() as connection:
            self.stored(name)
            wanted = np.unique(np.asarray(numbers, np.int64))
            if len(unknown := np.setdiff1d(wanted, stored.living(connection, name, wanted))):
                raise NotFound(f"Module '{name}' has no sample {unknown[0]}; nothing was removed.")
            return self._take_out(name, wanted)

    def untrain(self, name: str, demonstration: str) -> int:
        """Takes a demonstration's samples out of one module; returns how many. `NotFound` when it has none."""
        with self._store.write() as connection:
            numbers = stored.numbers_of(connection, self.stored(name).name, demonstration)
            if not len(numbers):
                raise NotFound(f"Module '{name}' has no sample of demonstration '{demonstration}'.")
            return self._take_out(name, numbers)

    def forget_demonstration(self, demonstration: str) -> None:
        """Takes a demonstration's samples out of every module, and of the snapshots: no rollback brings them back."""
        with self._store.write() as connection:
            for name in stored.modules_with(connection, demonstration):
                self._forget(name, stored.numbers_of(connection, name, demonstration))
                stored.erase(connection, name, demonstration)

    def _take_out(self, name: str, numbers: Integers) -> int:
        with self._store.write() as connection:
            self._forget(name, numbers)
            stored.take_out(connection, name, numbers)
            return len(numbers)

    def _forget(self, name: str, numbers: Integers) -> None:
        """Makes the module in memory follow: samples are on their way out of the store."""
        self._check_loaded()
        if len(numbers):
            self._store.afterwards(lambda: self._follow(name, lambda module: module.forget(numbers)))

    def replace(
        self,
        declaration: ModuleDeclaration,
        inputs: ArrayLike,
        outputs: ArrayLike,
        demonstrations: Sequence[str | None],
    ) -> Module:
        """Makes these samples the only ones of the module of that name, which is created if there is none.

        Returns the module that answers from the commit on.
        """
        name = declaration.name
        with self._store.write() as connection:
            known = stored.get(connection, name)
            if known is None:
                stored.create(connection, declaration)
            else:
                stored.redeclare(connection, declaration)
                stored.take_out(connection, name, stored.numbers_of(connection, name))
            rows, values = Module(declaration).checked(inputs, outputs, demonstrations)
            stored.add_samples(connection, name, rows, values, demonstrations)
            module = self._built(name)
            self._afterwards(name, module)
            return module

    # Training and snapshots

    def retrain(self, name: str, approximator: ApproximatorSettings | None, progress: Progress = _untold) -> Module:
        """Builds a module anew from the store, with other settings if they are given.

        Other writes go on meanwhile. What `progress` raises ends it, and the module stays as it was.
        """
        for left in reversed(range(_BUILDS)):
            # In the last attempt nothing may come between.
            with nullcontext() if left else self._store.write():
                changes = self._changes[name]
                progress(0.1)
                built = self._built(name, approximator)
                progress(0.9)
                with self._store.write() as connection:
                    if self._changes[name] == changes:
                        stored.redeclare(connection, built.declaration)
                        self._afterwards(name, built)
                        break
        return built

    def snapshots(self, name: str) -> tuple[Snapshot, ...]:
        """A module's snapshots, oldest first."""
        with self._store.read() as connection:
            return stored.all_snapshots(connection, self.stored(name, connection).name)

    def snapshot(self, name: str, snapshot: str) -> Snapshot:
        """Remembers the module as it is now; `Conflict` when the name is taken."""
        with self._store.write() as connection:
            module = self.stored(name)
            if any(each.name == snapshot for each in stored.all_snapshots(connection, name)):
                raise Conflict(f"Module '{name}' has a snapshot '{snapshot}' already; take another name.")
            return stored.snapshot(connection, module, snapshot)

    def roll_back(self, name: str, snapshot: str) -> StoredModule:
        """Makes a snapshot's samples and settings the module's again; `NotFound` when there is no such snapshot."""
        with self._store.write() as connection:
            self.stored(name)
            if not stored.roll_back(connection, name, snapshot):
                raise self._no_snapshot(name, snapshot)
            self._afterwards(name, self._built(name))
            return self.stored(name)

    def drop_snapshot(self, name: str, snapshot: str) -> None:
        """Forgets a snapshot; `NotFound` when there is none."""
        with self._store.write() as connection:
            self.stored(name)
            if not stored.drop_snapshot(connection, name, snapshot):
                raise self._no_snapshot(name, snapshot)

    def _no_snapshot(self, name: str, snapshot: str) -> NotFound:
        return NotFound(f"Module '{name}' has no snapshot '{snapshot}'; GET /v1/modules/{name}/snapshots lists them.")

    # Memory follows the store

    def _built(self, name: str, approximator: ApproximatorSettings | None = None) -> Module:
        """The module that the store's samples make, with other settings if they are given."""
        with self._store.read() as connection:  # one transaction: the samples fit the size
            module = self.stored(name, connection)
            pieces = list(stored.read_samples(connection, module))
        declaration = module.declaration.answering_by(approximator)
        width, height = len(declaration.inputs), len(declaration.outputs)
        taught = TaughtSamples(
            np.concatenate([np.zeros(0, np.int64), *(piece.numbers for piece in pieces)]),
            np.concatenate([np.zeros((0, width)), *(piece.inputs for piece in pieces)]),
            np.concatenate([np.zeros((0, height)), *(piece.outputs for piece in pieces)]),
            [shown for piece in pieces for shown in piece.demonstrations],
        )
        return Module.restored(declaration, taught, module.size)

    def _rebuilt(self, name: str) -> Module | None:
        """The same; None, and the reason in the log, when it cannot be built: the others are not to suffer by it."""
        try:
            return self._built(name)
        except Exception:
            log.exception("a module cannot be built from the store", module=name)
            return None

    def _afterwards(self, name: str, module: Module) -> None:
        def answer_by_it() -> None:
            self._changes[name] += 1
            self._live[name] = module

        self._store.afterwards(answer_by_it)

    def _follow(self, name: str, change: Callable[[Module], object]) -> None:
        """Does to a module in memory what was done to the store; should that fail, it is built anew."""
        self._changes[name] += 1
        try:
            change(self.live(name))
        except Exception:
            log.exception("a module in memory could not follow the store: it is built anew", module=name)
            self._live[name] = self._rebuilt(name)
