"""Demonstrations in the store, with what was observed in them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from sqlalchemy import Connection, delete, func, select

from handeye.modules.spaces import HandPoint, HeadAngles, ImagePair, ImagePoint
from handeye.server.demonstration import Demonstration, Observation
from handeye.server.store import counters
from handeye.server.store.rows import add, change, dumps, loads, now
from handeye.server.store.tables import demonstrations, gripper_actions, observations


def create(connection: Connection, task: str, object_name: str) -> str:
    """A new, empty demonstration; its id is '<task>-<n>' with n counting the task's demonstrations from 1."""
    number = counters.take(connection, f"demonstrations/{task}")
    name = f"{task}-{number}"
    add(
        connection,
        demonstrations,
        id=name,
        task=task,
        object=object_name,
        number=number,
        finished=False,
        outcome=None,
        created=now(),
    )
    return name


def read(connection: Connection, name: str) -> Demonstration | None:
    """The demonstration of that id; None when there is none."""
    return next(_demonstrations(connection, demonstrations.c.id == name), None)


def of_task(connection: Connection, task: str) -> tuple[Demonstration, ...]:
    """A task's demonstrations, in the order they were begun."""
    return tuple(_demonstrations(connection, demonstrations.c.task == task))


def page(connection: Connection, after: tuple[float, str] | None, limit: int) -> tuple[Demonstration, ...]:
    """At most `limit` demonstrations begun after (`created`, `id`), in the order they were begun."""
    created, name = demonstrations.c.created, demonstrations.c.id
    wanted = select(name).order_by(created, name).limit(limit)
    if after is not None:
        wanted = wanted.where((created > after[0]) | ((created == after[0]) & (name > after[1])))
    return tuple(_demonstrations(connection, name.in_(wanted)))


def add_observation(connection: Connection, name: str, observation: Observation) -> None:
    """Writes down what was observed."""
    found = observation.found
    content = dumps(
        {
            "subtask": observation.subtask,
            "towards": observation.object,
            "world_time": observation.world_time,
            "object": [*found.object.array().tolist(), found.object_confidence] if found else None,
            "hand": [*found.hand.array().tolist(), found.hand_confidence] if found else None,
            "outline": found.hand.outline if found and isinstance(found.hand, HandPoint) else None,
            "joints": observation.joints.tolist(),
            "goal": observation.goal,
            "key": observation.key,
            "head": observation.head.array().tolist() if observation.head else None,
            "seconds": observation.seconds,
        }
    )
    add(connection, observations, demonstration=name, number=observation.number, content=content)


def add_action(connection: Connection, name: str, subtask: str, action: str) -> None:
    """Writes down what the gripper did at a subtask's end."""
    add(connection, gripper_actions, demonstration=name, subtask=subtask, action=action)


def mark(connection: Connection, name: str, **changes: Any) -> None:
    """Changes `finished` or `outcome`."""
    change(connection, demonstrations, name, **changes)


def drop(connection: Connection, name: str) -> None:
    """Deletes a demonstration with what was observed."""
    connection.execute(delete(demonstrations).where(demonstrations.c.id == name))


def exists(connection: Connection, name: str) -> bool:
    """Whether there is a demonstration of that id."""
    wanted = select(func.count()).select_from(demonstrations).where(demonstrations.c.id == name)
    return bool(connection.execute(wanted).scalar_one())


def _demonstrations(connection: Connection, which: Any) -> Iterator[Demonstration]:
    """Those that fit, in the order they were begun; three queries, however many they are."""
    found = connection.execute(
        select(demonstrations).where(which).order_by(demonstrations.c.created, demonstrations.c.id)
    ).mappings()
    rows = found.all()
    names = select(demonstrations.c.id).where(which)
    observed: dict[str, list[Observation]] = defaultdict(list)
    of_these = select(observations).where(observations.c.demonstration.in_(names)).order_by(observations.c.number)
    objects = {row["id"]: row["object"] for row in rows}
    for row in connection.execute(of_these).mappings():
        observed[row["demonstration"]].append(_observation(dict(row), objects[row["demonstration"]]))
    acted: dict[str, dict[str, Any]] = defaultdict(dict)
    for row in connection.execute(select(gripper_actions).where(gripper_actions.c.demonstration.in_(names))).mappings():
        acted[row["demonstration"]][row["subtask"]] = row["action"]
    for row in rows:
        name = row["id"]
        yield Demonstration(
            id=name,
            task=row["task"],
            object=row["object"],
            observations=tuple(observed[name]),
            actions=acted[name],
            finished=row["finished"],
            outcome=row["outcome"],
            created=row["created"],
        )


def _observation(row: Mapping[str, Any], object_name: str) -> Observation:
    """Before there were tasks with several objects, all was towards the demonstration's, and there were no ways."""
    content = loads(row["content"])
    found = None
    if content["object"] is not None:
        *shown, object_confidence = content["object"]
        *hand, hand_confidence = content["hand"]
        outline = content.get("outline")
        seen = ImagePoint(*hand)
        if outline:
            seen = HandPoint(seen.row, seen.column, seen.disparity, tuple(map(tuple, outline)))
        found = ImagePair(ImagePoint(*shown), seen, object_confidence, hand_confidence)
    return Observation(
        number=row["number"],
        subtask=content["subtask"],
        object=content.get("towards", object_name),
        world_time=content["world_time"],
        found=found,
        joints=np.array(content["joints"], np.float64),
        goal=content["goal"],
        key=content["key"],
        head=HeadAngles(*content["head"]) if content.get("head") else None,
        seconds=content.get("seconds", 0.0),
    )
