"""Reads every row of a store once: what is wrong with it by itself, and what the rules between rows need of it."""

from __future__ import annotations

import math
import struct
import zlib
from array import array
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import orjson
from pydantic import ValidationError
from sqlalchemy import Connection, Table, and_, delete, insert, select, update
from sqlalchemy.exc import DBAPIError

from handeye.modules.declaration import ModuleDeclaration
from handeye.server.store.findings import Finding, entry, shown
from handeye.server.store.mending import mended
from handeye.server.store.modules import snapshot_numbers
from handeye.server.store.reading import Watch, damage, key_of, rows_of
from handeye.server.store.tables import (
    counters,
    demonstrations,
    job_events,
    jobs,
    metadata,
    modules,
    observations,
    samples,
    set_aside,
    snapshots,
    tasks,
)

JOB_STATES = ("queued", "running", "succeeded", "failed", "cancelled", "interrupted")
OUTCOMES = ("success", "failure")

_JSON = {
    observations: ("content",),
    tasks: ("content",),
    jobs: ("error", "result"),
    job_events: ("data",),
    set_aside: ("content",),
}
PARENTS = {child: next(iter(child.foreign_keys)).column.table for child in metadata.sorted_tables if child.foreign_keys}
"""Table → the table whose rows its rows belong to, by the first column of their key."""


@dataclass(frozen=True, slots=True)
class Trouble:
    """A finding, and how it is mended: `mend` does it and says in a sentence what it did."""

    finding: Finding
    mend: Callable[[Connection], str]


@dataclass(slots=True)
class SurveyedModule:
    """A module, and what its samples are like."""

    inputs: int
    outputs: int
    next_number: int
    numbers: array[int] = field(default_factory=lambda: array("q"))
    taught: Counter[str] = field(default_factory=lambda: Counter[str]())
    """How many living samples came from each demonstration."""


class Survey:
    """What a store holds, without the rows that are damaged."""

    def __init__(self) -> None:
        self.troubles: list[Trouble] = []
        self.unreadable: list[Finding] = []
        self.modules: dict[str, SurveyedModule] = {}
        self.keys: dict[Table, set[str]] = defaultdict(set)
        """The rows that other rows may belong to."""
        self.damaged: dict[Table, dict[str, dict[str, Any]]] = defaultdict(dict)
        """Of those, the ones that cannot be put right."""
        self.orphans: dict[Table, dict[str, Counter[str]]] = defaultdict(lambda: defaultdict(Counter))
        """Table → key of a row that is not there → how many rows of which tables belong to it."""
        self.highest: Counter[str] = Counter()
        """The highest number of a sample of each module that is not there."""
        self.used: Counter[str] = Counter()
        """The highest number that each counter has given."""
        self.changed = False
        """Bytes have changed on the disk."""
        self.snapshots: dict[tuple[str, str], dict[str, Any]] = {}
        self.tasks: dict[str, str] = {}
        """Task → module."""
        self.counters: dict[str, int] = {}
        self._collect: dict[Table, Callable[[dict[str, Any]], str | None]] = {
            modules: self._module,
            samples: self._sample,
            snapshots: self._snapshot,
            tasks: self._task,
            jobs: self._job,
            demonstrations: self._demonstration,
            counters: self._counter,
        }

    def read(self, connection: Connection, watch: Watch, without: Collection[str] = ()) -> None:
        """Reads all tables but those named."""
        for table in metadata.sorted_tables:
            if table.name in without:
                continue
            try:
                for row in rows_of(connection, table, watch):
                    self._look(table, row)
            except (DBAPIError, UnicodeDecodeError) as error:
                reason = error.orig if isinstance(error, DBAPIError) else error
                self.unreadable.append(Finding(table.name, "", f"it cannot be read: {shown(str(reason))}"))
                if connection.dialect.name != "sqlite":
                    return  # the transaction has failed

    def _look(self, table: Table, row: dict[str, Any]) -> None:
        problem = damage(table, row)
        if problem is not None:
            self.changed = True
            better = mended(table, row)
            if better is None:
                self._condemn(table, row, problem)
                return
            self.troubles.append(
                Trouble(Finding(table.name, key_of(table, row), problem), _putting(table, row, better))
            )
            row = better
        problem = _json_problem(table, row)
        if problem is None and table in self._collect:
            problem = self._collect[table](row)
        if problem is not None:
            self._condemn(table, row, problem)
            return
        if table in PARENTS.values():
            self.keys[table].add(row[table.primary_key.columns.keys()[0]])
        parent = PARENTS.get(table)
        if parent is not None:
            key = row[table.primary_key.columns.keys()[0]]
            if key not in self.keys[parent]:
                self.orphans[parent][key][table.name] += 1

    def _condemn(self, table: Table, row: dict[str, Any], problem: str) -> None:
        if table in PARENTS.values():
            # Other rows may hang on it: the rules see what can be done.
            self.damaged[table][key_of(table, row)] = {**row, "problem": problem}
            return
        finding = Finding(table.name, key_of(table, row), problem)
        self.troubles.append(Trouble(finding, lambda connection: put_aside(connection, table, [row], problem)))

    def _module(self, row: dict[str, Any]) -> str | None:
        shape = shape_of(row["declaration"])
        if shape is None:
            return "its declaration declares no module"
        self.modules[row["name"]] = SurveyedModule(*shape, row["next_number"])
        return None

    def _sample(self, row: dict[str, Any]) -> str | None:
        module, number = self.modules.get(row["module"]), row["number"]
        if module is None:
            self.highest[row["module"]] = max(self.highest[row["module"]], number)
            return None
        for name, length in (("input", module.inputs), ("output", module.outputs)):
            content = row[name]
            if len(content) != 8 * length:
                return f"its {name} has {len(content)} bytes, the module's declaration says {8 * length}"
            if not _finite(content, length):
                return f"its {name} holds what is no number"
        module.numbers.append(number)
        if row["live"] and row["demonstration"] is not None:
            module.taught[row["demonstration"]] += 1
        return None

    def _snapshot(self, row: dict[str, Any]) -> str | None:
        try:
            numbers = snapshot_numbers(row["numbers"])
        except (zlib.error, ValueError):
            return "its list of samples cannot be read"
        if len(numbers) != row["count"]:
            return f"it lists {len(numbers)} samples and says that they are {row['count']}"
        if shape_of(row["declaration"]) is None:
            return "its declaration declares no module"
        self.snapshots[row["module"], row["name"]] = row
        return None

    def _task(self, row: dict[str, Any]) -> None:
        self.tasks[row["name"]] = row["module"]

    def _job(self, row: dict[str, Any]) -> str | None:
        if row["state"] not in JOB_STATES:
            return f"its state {row['state']!r} is none of {', '.join(JOB_STATES)}"
        self.used["jobs"] = max(self.used["jobs"], row["number"])
        return None

    def _demonstration(self, row: dict[str, Any]) -> str | None:
        if row["outcome"] not in (None, *OUTCOMES):
            return f"its outcome {row['outcome']!r} is none of {', '.join(OUTCOMES)}"
        name = f"demonstrations/{row['task']}"
        self.used[name] = max(self.used[name], row["number"])
        return None

    def _counter(self, row: dict[str, Any]) -> None:
        self.counters[row["name"]] = row["next"]


def shape_of(declaration: str) -> tuple[int, int] | None:
    """How many inputs and outputs a declaration's JSON declares; None when it is none."""
    try:
        declared = ModuleDeclaration.model_validate_json(declaration)
    except ValidationError:
        return None
    return len(declared.inputs), len(declared.outputs)


def _finite(content: bytes, length: int) -> bool:
    values = struct.unpack(f"<{length}d", content)
    return math.isfinite(sum(values)) or all(map(math.isfinite, values))


def _json_problem(table: Table, row: Mapping[str, Any]) -> str | None:
    for name in _JSON.get(table, ()):
        if row[name] is not None:
            try:
                orjson.loads(row[name])
            except ValueError:
                return f"its {name} is no JSON"
    return None


def key_clause(table: Table, row: Mapping[str, Any]) -> Any:
    """The condition that selects the row."""
    return and_(*(column == row[column.name] for column in table.primary_key.columns))


def put_aside(connection: Connection, table: Table, rows: list[dict[str, Any]], problem: str) -> str:
    """Moves rows to table `set_aside`."""
    if rows:
        entries = [entry(table.name, key_of(table, row), problem, row) for row in rows]
        connection.execute(insert(set_aside), entries)
        for row in rows:
            connection.execute(delete(table).where(key_clause(table, row)))
    return "it was set aside" if len(rows) == 1 else f"{len(rows)} rows were set aside"


def rows_where(connection: Connection, table: Table, clause: Any) -> list[dict[str, Any]]:
    """The rows that a condition selects."""
    return [dict(row) for row in connection.execute(select(table).where(clause)).mappings()]


def _putting(table: Table, row: Mapping[str, Any], better: Mapping[str, Any]) -> Callable[[Connection], str]:
    def mend(connection: Connection) -> str:
        connection.execute(update(table).where(key_clause(table, row)).values(**better))
        return "one byte of it had changed: it was put right"

    return mend
