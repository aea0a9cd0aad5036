"""A store with rows of every kind."""

from __future__ import annotations

from typing import Any

import numpy as np
from sqlalchemy import Connection, select

from handeye.modules.declaration import ModuleDeclaration
from handeye.modules.spaces import ImagePair, ImagePoint
from handeye.server.demonstration import Observation
from handeye.server.store import Store, demonstrations, jobs, modules, objects, replies, rows, tasks
from handeye.server.store.findings import entry
from handeye.server.store.tables import metadata, set_aside, tokens

DECLARATION = ModuleDeclaration.model_validate(
    {
        "name": "reach",
        "inputs": [{"name": f"x{i}", "unit": "px"} for i in range(4)],
        "outputs": [{"name": f"joint{i}", "unit": "rad"} for i in range(6)],
    }
)
FREE = DECLARATION.model_copy(update={"name": "free"})


def fill(store: Store, samples: int = 300, pictures: int = 2) -> None:
    """Puts rows into every table; `samples` of them into module `reach`, a sixth of that into module `free`."""
    random = np.random.default_rng(11)
    with store.write() as connection:
        modules.create(connection, DECLARATION)
        modules.create(connection, FREE)
        for _ in range(4):
            show(connection, random, samples // 4)
        modules.add_samples(
            connection,
            "free",
            random.normal(size=(samples // 6, 4)),
            random.normal(size=(samples // 6, 6)),
            [None, "what a user calls it"] * (samples // 12),
        )
        stored = modules.get(connection, "reach")
        assert stored is not None
        modules.snapshot(connection, stored, "early")
        modules.take_out(connection, "reach", np.arange(3, dtype=np.int64))
        task = {"subtasks": [{"name": "grasp", "action": "close_gripper"}], "demonstrations": ["grasp-1"]}
        tasks.write(connection, "grasp", "reach", {**task, "statistics": {}})
        for _ in range(pictures):
            image = random.integers(0, 255, (48, 64, 3), np.uint8)
            objects.add_pair(connection, "blue cup", "examples", image, image)
        for number in range(8):
            name = f"job{number}"
            jobs.create(connection, name, "run", "grasp", "blue cup")
            jobs.update(connection, name, state="succeeded", result=rows.dumps({"looks": list(range(50))}), started=1.5)
            jobs.add_event(connection, name, 1, "state", {"state": "running"})
            jobs.add_picture(connection, name, 0, random.bytes(6000), 20)
        replies.remember(connection, "key-1", "fingerprint", replies.Reply(201, "/v1/modules/reach", '{"a":1}'))
        rows.add(
            connection, tokens, id="t1", name="first", role="admin", digest="ab" * 32, created=rows.now(), expires=None
        )
        connection.execute(set_aside.insert(), entry("samples", "old/1", "found before", {"input": b"\x01"}))


def show(connection: Connection, random: np.random.Generator, samples: int) -> str:
    """One demonstration, and the samples that came from it."""
    name = demonstrations.create(connection, "grasp", "blue cup")
    for number in range(12):
        place = ImagePoint(*random.uniform(0, 300, 3))
        demonstrations.add_observation(
            connection,
            name,
            Observation(
                number,
                "grasp",
                "blue cup",
                float(number),
                ImagePair(place, place),
                random.normal(size=6),
                goal=number == 11,
                key=True,
            ),
        )
    demonstrations.add_action(connection, name, "grasp", "close_gripper")
    demonstrations.mark(connection, name, finished=True, outcome="success")
    modules.add_samples(
        connection, "reach", random.normal(size=(samples, 4)), random.normal(size=(samples, 6)), [name] * samples
    )
    return name


def contents(connection: Connection) -> dict[str, dict[tuple[Any, ...], dict[str, Any]]]:
    """Table → primary key → row."""
    found: dict[str, dict[tuple[Any, ...], dict[str, Any]]] = {}
    for table in metadata.sorted_tables:
        key = [column.name for column in table.primary_key.columns]
        found[table.name] = {
            tuple(row[name] for name in key): dict(row) for row in connection.execute(select(table)).mappings()
        }
    return found
