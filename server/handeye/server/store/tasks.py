"""Trained tasks in the store: which module answers, in which subtasks, taught by whom."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Connection, RowMapping, delete, select

from handeye.server.store.rows import dumps, find, now, put
from handeye.server.store.tables import tasks


def write(connection: Connection, name: str, module: str, content: dict[str, Any]) -> None:
    """Writes a trained task down, in place of an earlier training of it."""
    put(connection, tasks, name=name, module=module, content=dumps(content), trained=now())


def read(connection: Connection, name: str) -> dict[str, Any] | None:
    """Its row; None when there is none."""
    return find(connection, tasks, name)


def all_tasks(connection: Connection) -> list[RowMapping]:
    """All rows, by name."""
    return list(connection.execute(select(tasks).order_by(tasks.c.name)).mappings())


def drop(connection: Connection, name: str) -> bool:
    """Forgets a task; False when there is none."""
    return bool(connection.execute(delete(tasks).where(tasks.c.name == name)).rowcount)


def of_module(connection: Connection, module: str) -> list[str]:
    """Names of the tasks that a module answers for."""
    return list(connection.execute(select(tasks.c.name).where(tasks.c.module == module)).scalars())
