"""What must hold between the rows of a store, and how it is restored where it does not."""

from __future__ import annotations

import math
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from sqlalchemy import Connection, Table, insert, select

from handeye.server.store import rows
from handeye.server.store.findings import Finding, entry
from handeye.server.store.modules import snapshot_numbers
from handeye.server.store.reading import damage
from handeye.server.store.survey import (
    OUTCOMES,
    PARENTS,
    Survey,
    Trouble,
    put_aside,
    rows_where,
    shape_of,
)
from handeye.server.store.tables import (
    counters,
    demonstrations,
    jobs,
    modules,
    objects,
    observations,
    set_aside,
    snapshots,
    tasks,
)

_LISTED = 5  # so many numbers are told of many


def troubles(survey: Survey) -> list[Trouble]:
    """Where rows of a surveyed store do not fit together, in the order in which it is to be mended."""
    return [trouble for rule in _RULES for trouble in rule(survey)]


def _lost_modules(survey: Survey) -> Iterator[Trouble]:
    for name, problem in _lost(survey, modules).items():

        def mend(connection: Connection, name: str = name) -> str:
            remains = _remains(connection, survey, modules, name)
            declared = max(
                (row for (module, _), row in survey.snapshots.items() if module == name),
                key=lambda row: float(row["created"]),
                default=None,
            )
            if declared is not None:
                declaration, said = declared["declaration"], f"as its snapshot '{declared['name']}' declares it"
            elif shape_of(str(remains.get("declaration"))) is not None:
                declaration = remains["declaration"]
                said = "with what can be read of its declaration: look at it before you trust its answers"
            else:
                return _set_aside_with_children(connection, survey, modules, name)
            created = _time(remains.get("created"))
            following = survey.highest[name] + 1
            rows.put(connection, modules, name=name, declaration=declaration, next_number=following, created=created)
            return f"it was made anew {said}"

        yield Trouble(Finding("modules", name, problem), mend)


def _lost_demonstrations(survey: Survey) -> Iterator[Trouble]:
    taught: Counter[str] = Counter()
    for module in set(survey.tasks.values()) & set(survey.modules):
        taught += survey.modules[module].taught
    lost = _lost(survey, demonstrations)
    for name in sorted(set(taught) - survey.keys[demonstrations]):
        lost.setdefault(name, f"it is not there, but {taught[name]} samples of tasks came from it")
    for name, problem in lost.items():

        def mend(connection: Connection, name: str = name) -> str:
            if _is_whole(survey, demonstrations, name):
                rows.change(connection, demonstrations, name, outcome=None)
                return "its outcome was taken away: say anew whether it was a success"
            remains = _remains(connection, survey, demonstrations, name)
            if not taught[name] and not survey.orphans[demonstrations][name]:
                return _set_aside_with_children(connection, survey, demonstrations, name)
            row = _renewed_demonstration(connection, name, remains, used=taught[name] > 0)
            rows.put(connection, demonstrations, **row)
            return f"it was made anew from what remains, with object '{row['object']}': look at it"

        yield Trouble(Finding("demonstrations", name, problem), mend)


def _renewed_demonstration(connection: Connection, name: str, remains: dict[str, Any], *, used: bool) -> dict[str, Any]:
    """Its id says task and number; the object is that of the task's other demonstrations where it cannot be read."""
    task, _, number = name.rpartition("-")
    shown = connection.execute(select(demonstrations.c.object).where(demonstrations.c.task == task)).scalars().all()
    known = set(connection.execute(select(objects.c.name)).scalars())
    readable = remains.get("object")
    candidates = [readable] if readable in known else [*shown, *([readable] if isinstance(readable, str) else [])]
    seen = rows_where(connection, observations, observations.c.demonstration == name)
    outcome = remains.get("outcome")
    return {
        "id": name,
        "task": task or name,
        "object": next(iter(candidates), "unknown"),
        "number": int(number) if number.isdecimal() and len(number) < 9 else 1,
        # Without observations it is nothing to train from.
        "finished": bool(seen) and (used or remains.get("finished") is True),
        "outcome": outcome if outcome in OUTCOMES else None,
        "created": _time(remains.get("created")),
    }


def _lost_objects(survey: Survey) -> Iterator[Trouble]:
    for name, problem in _lost(survey, objects).items():

        def mend(connection: Connection, name: str = name) -> str:
            remains = _remains(connection, survey, objects, name)
            if not survey.orphans[objects][name]:
                return _set_aside_with_children(connection, survey, objects, name)
            rows.put(connection, objects, name=name, created=_time(remains.get("created")))
            return "it was made anew from its pictures"

        yield Trouble(Finding("objects", name, problem), mend)


def _lost_jobs(survey: Survey) -> Iterator[Trouble]:
    for name, problem in _lost(survey, jobs).items():

        def mend(connection: Connection, name: str = name) -> str:
            if _is_whole(survey, jobs, name):
                error = rows.dumps({"code": "interrupted", "message": "The job's state was damaged in the store."})
                rows.change(connection, jobs, name, state="interrupted", error=error)
                return "it is called interrupted now"
            return _set_aside_with_children(connection, survey, jobs, name)

        yield Trouble(Finding("jobs", name, problem), mend)


def _snapshots(survey: Survey) -> Iterator[Trouble]:
    for (name, snapshot), row in survey.snapshots.items():
        if name not in survey.modules:
            continue
        numbers = snapshot_numbers(row["numbers"])
        there = np.frombuffer(survey.modules[name].numbers, np.int64)
        kept = np.intersect1d(numbers, there)
        if len(kept) == len(numbers):
            continue
        gone = np.setdiff1d(numbers, there)
        listed = ", ".join(map(str, gone[:_LISTED].tolist())) + (", …" if len(gone) > _LISTED else "")
        problem = f"{len(gone)} samples that it lists are not there: {listed}"

        def mend(connection: Connection, row: dict[str, Any] = row, kept: Any = kept, problem: str = problem) -> str:
            put_aside(connection, snapshots, [row], problem)
            content = zlib.compress(kept.astype("<i8").tobytes())
            plain = {key: value for key, value in row.items() if key != "checksum"}
            rows.add(connection, snapshots, **{**plain, "numbers": content, "count": len(kept)})
            return f"it lists the other {len(kept)} now; the longer list was set aside"

        yield Trouble(Finding("snapshots", f"{name}/{snapshot}", problem), mend)


def _numbers(survey: Survey) -> Iterator[Trouble]:
    for name, module in survey.modules.items():
        highest = max(module.numbers, default=-1)
        if highest >= module.next_number:
            problem = f"its next sample would be number {module.next_number}, but there is a sample {highest}"
            yield Trouble(Finding("modules", name, problem), _renumbering(name, highest + 1))
    for name, used in survey.used.items():
        following = survey.counters.get(name)
        if following is None or following <= used:
            problem = f"its next number would be {following or 1}, but {used} has been given"

            def mend(connection: Connection, name: str = name, used: int = used) -> str:
                rows.put(connection, counters, name=name, next=used + 1)
                return f"its next number is {used + 1} now"

            yield Trouble(Finding("counters", name, problem), mend)


def _renumbering(name: str, following: int) -> Callable[[Connection], str]:
    def mend(connection: Connection) -> str:
        rows.change(connection, modules, name, next_number=following)
        return f"its next sample will be number {following}"

    return mend


def _tasks(survey: Survey) -> Iterator[Trouble]:
    for name, module in survey.tasks.items():
        if module in survey.modules:
            continue
        problem = f"its module '{module}' is not there"

        def mend(connection: Connection, name: str = name, module: str = module, problem: str = problem) -> str:
            if rows.find(connection, modules, module) is not None:
                return "the module was made anew"
            put_aside(connection, tasks, rows_where(connection, tasks, tasks.c.name == name), problem)
            return f"it was set aside: train it again by POST /v1/tasks/{name}/train"

        yield Trouble(Finding("tasks", name, problem), mend)


_RULES = (_lost_modules, _lost_demonstrations, _lost_objects, _lost_jobs, _numbers, _snapshots, _tasks)


def _lost(survey: Survey, table: Table) -> dict[str, str]:
    """Key → what is wrong, of the rows that are damaged beyond repair or not there although others belong to them."""
    found = {key: str(row["problem"]) for key, row in survey.damaged[table].items()}
    for key, children in survey.orphans[table].items():
        belonging = " and ".join(f"{count} {name}" for name, count in sorted(children.items()))
        found.setdefault(key, f"it is not there, but {belonging} belong to it")
    return found


def _is_whole(survey: Survey, table: Table, key: str) -> bool:
    """Whether a lost row is there as it was written, and only says what cannot be."""
    row = survey.damaged[table].get(key)
    return row is not None and damage(table, row) is None


def _remains(connection: Connection, survey: Survey, table: Table, key: str) -> dict[str, Any]:
    """What can be read of a lost row, which is kept in table `set_aside`."""
    damaged = survey.damaged[table].get(key)
    if damaged is not None:
        damaged = dict(damaged)
        connection.execute(insert(set_aside), entry(table.name, key, damaged.pop("problem"), damaged))
        return damaged
    wanted = (
        select(set_aside.c.content)
        .where(set_aside.c.of_table == table.name, set_aside.c.row_key == key)
        .order_by(set_aside.c.found.desc())
        .limit(1)
    )
    found = connection.execute(wanted).scalar()
    return {} if found is None else dict(rows.loads(found))


def _set_aside_with_children(connection: Connection, survey: Survey, table: Table, key: str) -> str:
    """Moves a lost row's children to table `set_aside`, then deletes the row: its remains are there already."""
    moved = 0
    for child, parent in PARENTS.items():
        if parent is table:
            column = next(iter(child.primary_key.columns))
            belonging = rows_where(connection, child, column == key)
            put_aside(connection, child, belonging, f"its row in {table.name} is lost")
            moved += len(belonging)
    column = next(iter(table.primary_key.columns))
    connection.execute(table.delete().where(column == key))
    survey.damaged[table].pop(key, None)
    return f"it was set aside with {moved} rows that belong to it" if moved else "it was set aside"


def _time(value: Any) -> float:
    """A time that can be, else the present one."""
    possible = isinstance(value, float) and math.isfinite(value) and 0 < value <= rows.now()
    return value if possible else rows.now()
