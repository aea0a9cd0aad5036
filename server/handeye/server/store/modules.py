"""Modules in the store: declarations, samples, snapshots."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, and_, delete, func, insert, select

from handeye.modules.answers import TaughtSamples
from handeye.modules.declaration import ModuleDeclaration
from handeye.server.store.rows import add, change, find, now, seal
from handeye.server.store.tables import modules, samples, snapshots

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_AT_ONCE = 10_000
"""Rows that are read or written at a time."""

_FEW = 500
"""Numbers that one statement lists."""


@dataclass(frozen=True, slots=True)
class StoredModule:
    """A module's row."""

    name: str
    declaration: ModuleDeclaration
    size: int
    """The number of the next sample."""
    created: float
    """s since 1970."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """A module's samples at one moment, by name."""

    name: str
    samples: int
    created: float
    """s since 1970."""


def create(connection: Connection, declaration: ModuleDeclaration, size: int = 0) -> None:
    """A module without samples, whose first sample will get number `size`."""
    text = declaration.model_dump_json()
    add(connection, modules, name=declaration.name, declaration=text, next_number=size, created=now())


def all_modules(connection: Connection) -> tuple[StoredModule, ...]:
    """By name."""
    return tuple(_module(row) for row in connection.execute(select(modules).order_by(modules.c.name)).mappings())


def get(connection: Connection, name: str) -> StoredModule | None:
    """One of them; None when there is none."""
    row = find(connection, modules, name)
    return None if row is None else _module(row)


def redeclare(connection: Connection, declaration: ModuleDeclaration) -> None:
    """Replaces the declaration of the module of that name."""
    change(connection, modules, declaration.name, declaration=declaration.model_dump_json())


def drop(connection: Connection, name: str) -> None:
    """Deletes a module with its samples and snapshots."""
    connection.execute(delete(modules).where(modules.c.name == name))


def add_samples(
    connection: Connection, name: str, inputs: Floats, outputs: Floats, demonstrations: Sequence[str | None]
) -> int:
    """Adds samples (n, N), (n, M) with consecutive numbers; returns the first one's."""
    row = find(connection, modules, name)
    assert row is not None  # noqa: S101 # who adds samples has looked the module up in this transaction
    first = int(row["next_number"])
    change(connection, modules, name, next_number=first + len(inputs))
    ins, outs = np.ascontiguousarray(inputs, "<f8"), np.ascontiguousarray(outputs, "<f8")
    for start in range(0, len(ins), _AT_ONCE):
        chunk = range(start, min(start + _AT_ONCE, len(ins)))
        connection.execute(
            insert(samples),
            [
                seal(
                    samples,
                    {
                        "module": name,
                        "number": first + i,
                        "input": ins[i].tobytes(),
                        "output": outs[i].tobytes(),
                        "demonstration": demonstrations[i],
                        "live": True,
                    },
                )
                for i in chunk
            ],
        )
    return first


def read_samples(
    connection: Connection, module: StoredModule, after: int = -1, limit: int | None = None
) -> Iterator[TaughtSamples]:
    """The living samples with numbers above `after`, at most `limit` of them, in pieces."""
    left = limit
    while left is None or left > 0:
        wanted = _AT_ONCE if left is None else min(left, _AT_ONCE)
        found = connection.execute(
            select(samples.c.number, samples.c.input, samples.c.output, samples.c.demonstration)
            .where(samples.c.module == module.name, samples.c.number > after, samples.c.live)
            .order_by(samples.c.number)
            .limit(wanted)
        ).all()
        if found:
            numbers, inputs, outputs, demonstrations = zip(*found, strict=True)
            yield TaughtSamples(
                np.array(numbers, np.int64),
                _vectors(inputs, len(module.declaration.inputs)),
                _vectors(outputs, len(module.declaration.outputs)),
                demonstrations,
            )
            after = numbers[-1]
        if len(found) < wanted:
            return
        left = None if left is None else left - len(found)


def count(connection: Connection, name: str) -> int:
    """How many samples of a module are alive."""
    wanted = select(func.count()).select_from(samples).where(samples.c.module == name, samples.c.live)
    return int(connection.execute(wanted).scalar_one())


def demonstrations_of(connection: Connection, name: str) -> tuple[str, ...]:
    """The demonstrations that a module's living samples came from, by name."""
    wanted = (
        select(samples.c.demonstration)
        .where(samples.c.module == name, samples.c.live, samples.c.demonstration.is_not(None))
        .distinct()
        .order_by(samples.c.demonstration)
    )
    return tuple(connection.execute(wanted).scalars())


def numbers_of(connection: Connection, name: str, demonstration: str | None = None) -> Integers:
    """Numbers of a module's living samples, ascending; only those of one demonstration when it is given."""
    wanted = select(samples.c.number).where(samples.c.module == name, samples.c.live)
    if demonstration is not None:
        wanted = wanted.where(samples.c.demonstration == demonstration)
    return np.array(connection.execute(wanted.order_by(samples.c.number)).scalars().all(), np.int64)


def modules_with(connection: Connection, demonstration: str) -> tuple[str, ...]:
    """Names of the modules that have samples of a demonstration, living ones or in snapshots."""
    wanted = select(samples.c.module).where(samples.c.demonstration == demonstration).distinct()
    return tuple(connection.execute(wanted).scalars())


def living(connection: Connection, name: str, numbers: Integers) -> Integers:
    """Those of the numbers that belong to living samples."""
    found: list[int] = []
    for some in _parts(numbers):
        wanted = select(samples.c.number).where(samples.c.module == name, samples.c.number.in_(some), samples.c.live)
        found += connection.execute(wanted).scalars()
    return np.array(found, np.int64)


def take_out(connection: Connection, name: str, numbers: Integers) -> None:
    """Takes living samples out. Those that a snapshot has are kept for it, the others are deleted."""
    kept = np.intersect1d(numbers, _remembered(connection, name))
    _set_live(connection, name, kept, live=False)
    _delete(connection, name, np.setdiff1d(numbers, kept))


def erase(connection: Connection, name: str, demonstration: str) -> None:
    """Deletes a demonstration's samples for good: snapshots do not have them any more either."""
    mine = and_(samples.c.module == name, samples.c.demonstration == demonstration)
    gone = np.array(connection.execute(select(samples.c.number).where(mine)).scalars().all(), np.int64)
    for row in connection.execute(select(snapshots).where(snapshots.c.module == name)).mappings().all():
        numbers = snapshot_numbers(row["numbers"])
        left = np.setdiff1d(numbers, gone)
        if len(left) < len(numbers):
            change(connection, snapshots, name, row["name"], **_listed(left))
    connection.execute(delete(samples).where(mine))


def snapshot(connection: Connection, module: StoredModule, name: str) -> Snapshot:
    """Remembers the module's living samples and declaration under `name`."""
    numbers = numbers_of(connection, module.name)
    made = Snapshot(name, len(numbers), now())
    add(
        connection,
        snapshots,
        module=module.name,
        name=name,
        declaration=module.declaration.model_dump_json(),
        created=made.created,
        **_listed(numbers),
    )
    return made


def all_snapshots(connection: Connection, name: str) -> tuple[Snapshot, ...]:
    """Of one module, oldest first."""
    wanted = (
        select(snapshots.c.name, snapshots.c.count, snapshots.c.created)
        .where(snapshots.c.module == name)
        .order_by(snapshots.c.created, snapshots.c.name)
    )
    return tuple(Snapshot(*row) for row in connection.execute(wanted))


def roll_back(connection: Connection, name: str, snapshot_name: str) -> bool:
    """Makes the snapshot's samples and declaration the module's; False when there is no such snapshot."""
    row = find(connection, snapshots, name, snapshot_name)
    if row is None:
        return False
    wanted, present = snapshot_numbers(row["numbers"]), numbers_of(connection, name)
    take_out(connection, name, np.setdiff1d(present, wanted))
    _set_live(connection, name, np.setdiff1d(wanted, present), live=True)
    change(connection, modules, name, declaration=row["declaration"])
    return True


def drop_snapshot(connection: Connection, name: str, snapshot_name: str) -> bool:
    """Forgets a snapshot, and the samples that only it had; False when there is none."""
    row = find(connection, snapshots, name, snapshot_name)
    if row is None:
        return False
    connection.execute(delete(snapshots).where(snapshots.c.module == name, snapshots.c.name == snapshot_name))
    unneeded = np.setdiff1d(snapshot_numbers(row["numbers"]), _remembered(connection, name))
    _delete(connection, name, np.setdiff1d(unneeded, numbers_of(connection, name)))
    return True


def snapshot_numbers(content: bytes) -> Integers:
    """The sample numbers (n,) in a snapshot's row."""
    return np.frombuffer(zlib.decompress(content), "<i8").astype(np.int64)


def _listed(numbers: Integers) -> dict[str, Any]:
    """What a snapshot's row has of the samples' numbers (n,), which ascend."""
    return {"numbers": zlib.compress(numbers.astype("<i8").tobytes()), "count": len(numbers)}


def _set_live(connection: Connection, name: str, numbers: Integers, *, live: bool) -> None:
    for some in _parts(numbers):
        mine = and_(samples.c.module == name, samples.c.number.in_(some))
        rows = [
            seal(samples, {**row, "live": live}) for row in connection.execute(select(samples).where(mine)).mappings()
        ]
        connection.execute(delete(samples).where(mine))
        if rows:
            connection.execute(insert(samples), rows)


def _delete(connection: Connection, name: str, numbers: Integers) -> None:
    for some in _parts(numbers):
        connection.execute(delete(samples).where(samples.c.module == name, samples.c.number.in_(some)))


def _remembered(connection: Connection, name: str) -> Integers:
    """The numbers of the samples that the module's snapshots have."""
    wanted = select(snapshots.c.numbers).where(snapshots.c.module == name)
    parts = [snapshot_numbers(content) for content in connection.execute(wanted).scalars()]
    return np.unique(np.concatenate([np.zeros(0, np.int64), *parts]))


def _parts(numbers: Integers) -> Iterator[list[int]]:
    """As many at a time as one statement lists."""
    for start in range(0, len(numbers), _FEW):
        yield numbers[start : start + _FEW].tolist()


def _vectors(contents: Sequence[bytes], components: int) -> Floats:
    return np.frombuffer(b"".join(contents), "<f8").reshape(len(contents), components).astype(np.float64)


def _module(row: Any) -> StoredModule:
    declaration = ModuleDeclaration.model_validate_json(row["declaration"])
    return StoredModule(row["name"], declaration, int(row["next_number"]), float(row["created"]))
