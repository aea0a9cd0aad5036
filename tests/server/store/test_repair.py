from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from sqlalchemy import Connection, Table, delete, select, text, update

from handeye.server.store import Store, StoreBusy, StoreError, modules, rows
from handeye.server.store.check import verify
from handeye.server.store.repair import repair
from handeye.server.store.tables import (
    counters,
    demonstrations,
    gripper_actions,
    job_events,
    jobs,
    objects,
    observations,
    samples,
    set_aside,
    snapshots,
    tasks,
)
from handeye.server.store.tables import modules as modules_table
from tests.server.store.example import contents, fill

Contents = dict[str, dict[tuple[Any, ...], dict[str, Any]]]


def ruin(url: str, how: Callable[[Connection], None]) -> None:
    """Changes a store behind its back; no constraint is heeded."""
    with Store.open(url) as store, store.engine.connect() as connection:
        if store.engine.dialect.name == "sqlite":
            connection.exec_driver_sql("COMMIT")
            connection.exec_driver_sql("PRAGMA foreign_keys=OFF")
            connection.exec_driver_sql("BEGIN")
        else:
            connection.execute(text("SET session_replication_role = replica"))
        how(connection)
        connection.commit()
        if store.engine.dialect.name == "sqlite":
            connection.exec_driver_sql("PRAGMA foreign_keys=ON")


def read(url: str) -> Contents:
    with Store.open(url) as store, store.read() as connection:
        return contents(connection)


def set_values(
    table: Table, key: tuple[Any, ...], *, sealed: bool = True, **changes: Any
) -> Callable[[Connection], None]:
    """Changes a row; with its checksum, or without as a flipped byte does."""

    def how(connection: Connection) -> None:
        if sealed:
            rows.change(connection, table, *key, **changes)
        else:
            clauses = [column == value for column, value in zip(table.primary_key.columns, key, strict=True)]
            connection.execute(update(table).where(*clauses).values(**changes))

    return how


def drop(table: Table, *clauses: Any) -> Callable[[Connection], None]:
    def how(connection: Connection) -> None:
        connection.execute(delete(table).where(*clauses))

    return how


def sql(statement: str) -> Callable[[Connection], None]:
    def how(connection: Connection) -> None:
        connection.execute(text(statement))

    return how


def vector(*values: float) -> bytes:
    return struct.pack(f"<{len(values)}d", *values)


def said(url: str) -> str:
    return "\n".join(map(str, verify(url)))


class TestNothingWrong:
    def test_a_full_store_is_well(self, filled: str) -> None:
        before = read(filled)
        assert verify(filled) == []
        report = repair(filled)
        assert (report.done, report.original) == ((), None)
        assert read(filled) == before

    def test_an_empty_store_too(self, url: str) -> None:
        Store.open(url).close()
        assert verify(url) == []

    def test_it_is_looked_at_while_it_is_used(self, url: str) -> None:
        with Store.open(url) as store:
            fill(store)
            assert verify(url) == []
            with pytest.raises(StoreBusy):
                repair(url)

    def test_progress_is_told(self, filled: str) -> None:
        told: list[str] = []
        verify(filled, lambda table, _rows: told.append(table))
        assert {"modules", "samples", "jobs"} <= set(told)

    def test_there_must_be_a_store(self, sqlite_url: str, postgres_url: str) -> None:
        for url in (sqlite_url, postgres_url):
            with pytest.raises(StoreError, match="no store"):
                verify(url)
            with pytest.raises(StoreError, match="no store"):
                repair(url)

    def test_another_version_is_not_judged(self, filled: str) -> None:
        ruin(
            filled,
            sql("UPDATE alembic_version SET version_num = '0000'"),
        )
        for work in (verify, repair):
            with pytest.raises(StoreError, match="version '0000'"):
                work(filled)


class TestRows:
    """Rows that are wrong by themselves: what is in them goes to `set_aside`, all others stay."""

    @pytest.mark.parametrize(
        ("table", "key", "changes", "problem"),
        [
            (
                samples,
                ("reach", 40),
                {"input": vector(1, 2, 3)},
                "its input has 24 bytes, the module's declaration says 32",
            ),
            (samples, ("reach", 40), {"output": vector(*[math.nan] * 6)}, "its output holds what is no number"),
            (samples, ("reach", 40), {"input": vector(1, math.inf, 1, -math.inf)}, "its input holds what is no number"),
            (tasks, ("grasp",), {"content": '{"subtasks": ['}, "its content is no JSON"),
            (observations, ("grasp-1", 3), {"content": "nonsense"}, "its content is no JSON"),
            (job_events, ("job2", 1), {"data": ""}, "its data is no JSON"),
            (snapshots, ("reach", "early"), {"numbers": b"\x00\x01"}, "its list of samples cannot be read"),
            (snapshots, ("reach", "early"), {"count": 2}, "and says that they are 2"),
        ],
    )
    def test_with_a_fitting_checksum(
        self, filled: str, table: Table, key: tuple[Any, ...], changes: dict[str, Any], problem: str
    ) -> None:
        before = read(filled)
        ruin(filled, set_values(table, key, **changes))
        assert problem in said(filled)
        report = repair(filled)
        assert any("set aside" in each.remedy for each in report.done)
        assert verify(filled) == []
        after = read(filled)
        [aside] = [row for row in after["set_aside"].values() if row not in before["set_aside"].values()][:1]
        assert (aside["of_table"], aside["row_key"]) == (table.name, "/".join(map(str, key)))
        assert key not in after[table.name]
        for name in before.keys() - {table.name, "set_aside", "snapshots"}:
            assert after[name] == before[name]
        assert after[table.name] == {each: row for each, row in before[table.name].items() if each != key}

    @pytest.mark.parametrize(
        ("table", "key", "changes"),
        [
            (samples, ("reach", 40), {"input": vector(*np.random.default_rng(1).normal(size=4))}),
            (samples, ("free", 4), {"demonstration": "somebody else"}),
            (job_events, ("job2", 1), {"data": '{"state": "succeeded"}'}),
            (observations, ("grasp-1", 3), {"content": "{}"}),
        ],
    )
    def test_with_a_wrong_one(self, filled: str, table: Table, key: tuple[Any, ...], changes: dict[str, Any]) -> None:
        before = read(filled)
        ruin(filled, set_values(table, key, sealed=False, **changes))
        assert "its checksum does not fit" in said(filled)
        report = repair(filled)
        assert (report.original is None) == filled.startswith("postgresql")
        assert verify(filled) == []
        after = read(filled)
        assert after[table.name] == {each: row for each, row in before[table.name].items() if each != key}
        assert any(row["row_key"] == "/".join(map(str, key)) for row in after["set_aside"].values())

    @pytest.mark.parametrize(
        ("table", "key", "changes"),
        [
            (modules_table, ("free",), {"created": 12.5}),
            (jobs, ("job3",), {"kind": "sun"}),
            (demonstrations, ("grasp-2",), {"object": "blue cut"}),
            (objects, ("blue cup",), {"checksum": None}),
            (counters, ("jobs",), {"next": 8}),
        ],
    )
    def test_one_changed_byte_is_put_right(
        self, filled: str, table: Table, key: tuple[Any, ...], changes: dict[str, Any]
    ) -> None:
        before = read(filled)
        row = before[table.name][key]
        if "created" in changes:
            bits = struct.unpack("<q", struct.pack("<d", row["created"]))[0] ^ 0x20
            changes = {"created": struct.unpack("<d", struct.pack("<q", bits))[0]}
        if "checksum" in changes:
            changes = {"checksum": row["checksum"] ^ 0x7000}
        ruin(filled, set_values(table, key, sealed=False, **changes))
        assert len(verify(filled)) == 1
        [done] = repair(filled).done
        assert "put right" in done.remedy
        assert read(filled) == before


class TestBetweenRows:
    """Rows that do not fit to each other."""

    def test_a_demonstration_that_is_missing(self, filled: str) -> None:
        before = read(filled)
        ruin(filled, drop(demonstrations, demonstrations.c.id == "grasp-2"))
        assert (
            "demonstrations grasp-2: it is not there, but 1 gripper_actions and 12 observations belong to it"
            in said(filled)
        )
        [done] = repair(filled).done
        assert "made anew from what remains, with object 'blue cup'" in done.remedy
        assert verify(filled) == []
        after = read(filled)
        made, lost = (each["demonstrations"][("grasp-2",)] for each in (after, before))
        assert {**made, "created": 0, "checksum": 0, "outcome": "success"} == {**lost, "created": 0, "checksum": 0}
        for name in before.keys() - {"demonstrations"}:
            assert after[name] == before[name]

    def test_one_of_which_only_samples_remain(self, filled: str) -> None:
        def how(connection: Connection) -> None:
            for table, column in (
                (demonstrations, demonstrations.c.id),
                (observations, observations.c.demonstration),
                (gripper_actions, gripper_actions.c.demonstration),
            ):
                connection.execute(delete(table).where(column == "grasp-3"))

        ruin(filled, how)
        assert "demonstrations grasp-3: it is not there, but 75 samples of tasks came from it" in said(filled)
        repair(filled)
        assert verify(filled) == []
        after = read(filled)
        # The samples answer; without observations it is nothing to train from.
        assert sum(row["demonstration"] == "grasp-3" for row in after["samples"].values()) == 75
        assert after["demonstrations"][("grasp-3",)]["finished"] is False

    def test_names_that_users_give_are_no_demonstrations(self, filled: str) -> None:
        with Store.open(filled) as store, store.write() as connection:
            modules.add_samples(connection, "free", np.zeros((1, 4)), np.zeros((1, 6)), ["grasp-99"])
        assert verify(filled) == []

    def test_a_module_that_is_missing_comes_from_its_snapshot(self, filled: str) -> None:
        before = read(filled)
        ruin(filled, drop(modules_table, modules_table.c.name == "reach"))
        assert "modules reach: it is not there, but 300 samples and 1 snapshots belong to it" in said(filled)
        repair(filled)
        assert verify(filled) == []
        after = read(filled)
        made = after["modules"][("reach",)]
        assert (made["declaration"], made["next_number"]) == (before["modules"][("reach",)]["declaration"], 300)
        assert after["samples"] == before["samples"]

    def test_without_one_its_samples_are_set_aside(self, filled: str) -> None:
        before = read(filled)
        ruin(filled, drop(modules_table, modules_table.c.name == "free"))
        repair(filled)
        assert verify(filled) == []
        after = read(filled)
        aside = {row["row_key"] for row in after["set_aside"].values() if row["of_table"] == "samples"}
        assert aside >= {f"free/{number}" for number in range(50)}
        assert after["samples"] == {key: row for key, row in before["samples"].items() if key[0] != "free"}

    def test_a_damaged_declaration_that_can_be_read_keeps_its_samples(self, filled: str) -> None:
        before = read(filled)
        changes = {
            "declaration": before["modules"][("free",)]["declaration"].replace('"joint0"', '"joint9"'),
            "created": 5.0,
        }
        changes["declaration"] = changes["declaration"].replace("x3", "y4")
        ruin(filled, set_values(modules_table, ("free",), sealed=False, **changes))
        report = repair(filled)
        assert any("look at it before you trust its answers" in each.remedy for each in report.done)
        assert verify(filled) == []
        after = read(filled)
        assert after["samples"] == before["samples"]
        assert any(row["of_table"] == "modules" for row in after["set_aside"].values())

    def test_one_that_declares_nothing_does_not(self, filled: str) -> None:
        ruin(filled, set_values(modules_table, ("free",), declaration="{}"))
        assert "modules free: its declaration declares no module" in said(filled)
        repair(filled)
        assert verify(filled) == []
        assert ("free",) not in read(filled)["modules"]

    def test_an_object_that_is_missing(self, filled: str) -> None:
        before = read(filled)
        ruin(filled, drop(objects))
        assert "2 object_pictures belong to it" in said(filled)
        repair(filled)
        assert verify(filled) == []
        after = read(filled)
        assert set(after["objects"]) == {("blue cup",)}
        assert after["object_pictures"] == before["object_pictures"]

    def test_a_job_that_is_missing(self, filled: str) -> None:
        ruin(filled, drop(jobs, jobs.c.id == "job1"))
        assert "jobs job1: it is not there, but 1 job_events and 1 look_pictures belong to it" in said(filled)
        repair(filled)
        assert verify(filled) == []
        after = read(filled)
        assert {row["of_table"] for row in after["set_aside"].values() if row["row_key"].startswith("job1/")} == {
            "job_events",
            "look_pictures",
        }
        assert len(after["jobs"]) == len(after["job_events"]) == 7

    def test_a_job_in_no_state(self, filled: str) -> None:
        ruin(filled, set_values(jobs, ("job1",), state="sleeping"))
        assert "jobs job1: its state 'sleeping' is none of queued, running" in said(filled)
        repair(filled)
        assert verify(filled) == []
        assert read(filled)["jobs"][("job1",)]["state"] == "interrupted"

    def test_a_demonstration_with_another_outcome(self, filled: str) -> None:
        ruin(filled, set_values(demonstrations, ("grasp-1",), outcome="so-so"))
        assert "its outcome 'so-so' is none of success, failure" in said(filled)
        repair(filled)
        assert verify(filled) == []
        assert read(filled)["demonstrations"][("grasp-1",)]["outcome"] is None

    def test_a_snapshot_of_samples_that_are_gone(self, filled: str) -> None:
        ruin(filled, drop(samples, samples.c.module == "reach", samples.c.number.in_([0, 1, 17])))
        assert "snapshots reach/early: 3 samples that it lists are not there: 0, 1, 17" in said(filled)
        repair(filled)
        assert verify(filled) == []
        row = read(filled)["snapshots"][("reach", "early")]
        numbers = np.frombuffer(zlib.decompress(row["numbers"]), "<i8")
        assert row["count"] == len(numbers) == 297
        assert not {0, 1, 17} & set(numbers.tolist())

    def test_a_task_without_its_module(self, filled: str) -> None:
        ruin(filled, set_values(tasks, ("grasp",), module="gone"))
        assert "tasks grasp: its module 'gone' is not there" in said(filled)
        report = repair(filled)
        assert "POST /v1/tasks/grasp/train" in report.done[0].remedy
        assert verify(filled) == []

    @pytest.mark.parametrize(
        ("how", "problem"),
        [
            (
                set_values(modules_table, ("reach",), next_number=7),
                "its next sample would be number 7, but there is a sample 299",
            ),
            (
                set_values(counters, ("jobs",), next=3),
                "counters jobs: its next number would be 3, but 8 has been given",
            ),
            (drop(counters, counters.c.name == "demonstrations/grasp"), "would be 1, but 4 has been given"),
        ],
    )
    def test_numbers_that_would_be_given_twice(
        self, filled: str, how: Callable[[Connection], None], problem: str
    ) -> None:
        before = read(filled)
        ruin(filled, how)
        assert problem in said(filled)
        repair(filled)
        assert verify(filled) == []
        assert read(filled) == before

    def test_much_at_once(self, filled: str) -> None:
        def how(connection: Connection) -> None:
            connection.execute(delete(demonstrations))
            connection.execute(delete(objects))
            connection.execute(delete(counters))
            connection.execute(delete(jobs).where(jobs.c.number < 5))
            connection.execute(delete(modules_table))
            connection.execute(update(samples).where(samples.c.number == 9).values(live=False))

        ruin(filled, how)
        assert len(verify(filled)) > 10
        repair(filled)
        assert verify(filled) == []
        with Store.open(filled) as store, store.read() as connection:
            assert connection.execute(select(set_aside.c.of_table).distinct()).scalars().all()


class TestTables:
    @pytest.mark.parametrize("table", ["replies", "look_pictures"])
    def test_a_table_that_is_missing_is_made_anew(self, filled: str, table: str) -> None:
        before = read(filled)
        ruin(filled, sql(f"DROP TABLE {table}"))
        assert f"{table}: the table is missing" in said(filled)
        repair(filled)
        assert verify(filled) == []
        assert read(filled) == {**before, table: {}}

    def test_an_index_that_is_missing_too(self, filled: str) -> None:
        before = read(filled)
        ruin(filled, sql("DROP INDEX ix_samples_module_demonstration"))
        assert "samples: its index ix_samples_module_demonstration is missing" in said(filled)
        repair(filled)
        assert verify(filled) == []
        assert read(filled) == before

    def test_a_column_that_is_missing_is_beyond_repair(self, postgres_url: str) -> None:
        with Store.open(postgres_url) as store:
            fill(store)
        ruin(postgres_url, sql("ALTER TABLE jobs DROP COLUMN started"))
        assert "jobs: its column started is missing" in said(postgres_url)
        with pytest.raises(
            StoreError, match="started is missing; it cannot be mended, nothing was changed: restore a backup"
        ):
            repair(postgres_url)
