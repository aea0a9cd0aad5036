from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from sqlalchemy import NullPool, create_engine, inspect, select, text

from handeye.server.store import Store, StoreBusy, StoreError, rows, upgrade
from handeye.server.store.engine import connect, parse
from handeye.server.store.tables import counters, metadata


def put(store: Store, name: str, number: int) -> None:
    with store.write() as connection:
        rows.put(connection, counters, name=name, next=number)


def names(store: Store) -> set[str]:
    with store.read() as connection:
        return set(connection.execute(select(counters.c.name)).scalars())


def fails() -> pytest.RaisesExc[ZeroDivisionError]:
    """Something goes wrong inside."""
    return pytest.raises(ZeroDivisionError)


def shape(store: Store) -> dict[str, object]:
    """All that a database says about its tables."""
    looked = inspect(store.engine)
    return {
        table: (
            sorted((column["name"], str(column["type"]), column["nullable"]) for column in looked.get_columns(table)),
            looked.get_pk_constraint(table),
            sorted(looked.get_foreign_keys(table), key=str),
            sorted(looked.get_unique_constraints(table), key=str),
            sorted(looked.get_indexes(table), key=str),
        )
        for table in looked.get_table_names()
    }


class TestMigrations:
    def test_all_of_them_make_what_a_new_store_has(self, url: str, store: Store) -> None:
        fresh = shape(store)
        with store.engine.begin() as connection:
            metadata.drop_all(connection)
            connection.execute(text("DROP TABLE alembic_version"))
        engine = connect(parse(url))
        with engine.connect().execution_options(handeye_write=True) as connection, connection.begin():
            config = Config()
            config.set_main_option("script_location", str(Path(upgrade.__file__).parent / "migrations"))
            config.attributes["connection"] = connection
            command.upgrade(config, "head")
        engine.dispose()
        assert shape(store) == fresh
        with store.read() as connection:
            context = MigrationContext.configure(connection, opts={"compare_type": True})
            assert compare_metadata(context, metadata) == []
            assert context.get_current_revision() == upgrade.newest()

    def test_opening_again_changes_nothing(self, url: str, store: Store) -> None:
        put(store, "jobs", 7)
        store.close()
        with Store.open(url) as again:
            assert names(again) == {"jobs"}

    def test_a_version_from_the_future_is_refused_in_a_sentence(self, url: str, store: Store) -> None:
        with store.write() as connection:
            connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
        store.close()
        with pytest.raises(StoreError, match="version that this handeye does not know"):
            Store.open(url)


class TestOwnership:
    def test_one_process_at_a_time(self, url: str, store: Store) -> None:
        code = f"from handeye.server.store import Store\nStore.open({url!r})"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
        assert "StoreBusy" in done.stderr
        assert "in use by" in done.stderr
        store.close()
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr

    def test_closing_again_does_nothing(self, url: str, store: Store) -> None:
        store.close()
        with Store.open(url):
            store.close()
            with pytest.raises(StoreBusy):
                Store.open(url)

    def test_nor_twice_in_one_process(self, url: str, store: Store) -> None:
        with pytest.raises(StoreBusy, match="end that one first"):
            Store.open(url)

    def test_a_dead_owner_holds_nothing(self, url: str) -> None:
        code = f"import os\nfrom handeye.server.store import Store\nStore.open({url!r})\nos.kill(os.getpid(), 9)"
        subprocess.run([sys.executable, "-c", code], timeout=60)
        Store.open(url).close()


class TestTransactions:
    def test_a_write_is_there_afterwards_and_undone_when_it_raises(self, store: Store) -> None:
        put(store, "kept", 1)
        with fails(), store.write() as connection:
            rows.put(connection, counters, name="undone", next=1)
            raise ZeroDivisionError
        assert names(store) == {"kept"}

    def test_nested_writes_are_one(self, store: Store) -> None:
        with fails(), store.write():
            put(store, "inner", 1)
            assert names(store) == {"inner"}
            raise ZeroDivisionError
        assert names(store) == set()
        with store.write():
            put(store, "inner", 1)
        assert names(store) == {"inner"}

    def test_others_do_not_see_what_is_not_committed(self, store: Store) -> None:
        seen: list[set[str]] = []
        with store.write() as connection:
            rows.put(connection, counters, name="new", next=1)
            reader = threading.Thread(target=lambda: seen.append(names(store)))
            reader.start()
            reader.join(10)
        assert seen == [set()]
        assert names(store) == {"new"}

    def test_a_read_sees_one_state(self, store: Store) -> None:
        put(store, "a", 1)
        with store.read() as connection:
            before = set(connection.execute(select(counters.c.name)).scalars())
            writer = threading.Thread(target=put, args=(store, "b", 1))
            writer.start()
            writer.join(10)
            assert set(connection.execute(select(counters.c.name)).scalars()) == before
        assert names(store) == {"a", "b"}

    def test_afterwards_comes_once_and_before_the_next_write(self, store: Store) -> None:
        called: list[str] = []
        with store.write() as connection:
            store.afterwards(lambda: called.append("first"))
            with store.write():
                store.afterwards(lambda: called.append("second"))
            rows.put(connection, counters, name="a", next=1)
            assert called == []
        assert called == ["first", "second"]
        with fails(), store.write():
            store.afterwards(lambda: called.append("never"))
            raise ZeroDivisionError
        put(store, "b", 1)
        assert called == ["first", "second"]

    def test_writes_of_threads_follow_each_other(self, store: Store) -> None:
        def count() -> None:
            for _ in range(20):
                with store.write() as connection:
                    row = rows.find(connection, counters, "shared")
                    rows.put(connection, counters, name="shared", next=1 if row is None else row["next"] + 1)

        threads = [threading.Thread(target=count) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60)
        with store.read() as connection:
            row = rows.find(connection, counters, "shared")
        assert row is not None
        assert row["next"] == 80

    def test_a_lost_connection_costs_neither_the_store_nor_its_owner(self, postgres_url: str) -> None:
        others = text("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid()")
        with Store.open(postgres_url) as store:
            admin = create_engine(store.engine.url, isolation_level="AUTOCOMMIT", poolclass=NullPool)
            with admin.connect() as connection:
                connection.execute(others)
            put(store, "a", 1)
            with pytest.raises(StoreBusy):
                Store.open(postgres_url)
            with admin.connect() as connection:
                connection.execute(others)
                connection.execute(text("SELECT pg_advisory_lock(:key)"), {"key": 0x68616E64})
                with pytest.raises(StoreBusy, match="another process"):
                    put(store, "b", 2)
            put(store, "b", 2)

    def test_every_connection_waits_for_the_disk_and_leaves_nothing_deleted_on_it(self, store: Store) -> None:
        if store.engine.dialect.name != "sqlite":
            pytest.skip("PostgreSQL does by itself")
        with store.write() as one, store.engine.connect() as two:
            for connection in (one, two):
                assert connection.execute(text("PRAGMA synchronous")).scalar() == 2
                assert connection.execute(text("PRAGMA journal_mode")).scalar() == "wal"
                assert connection.execute(text("PRAGMA foreign_keys")).scalar() == 1
                assert connection.execute(text("PRAGMA secure_delete")).scalar() == 1

    def test_nobody_else_may_read_it(self, store: Store) -> None:
        if store.engine.dialect.name != "sqlite":
            pytest.skip("PostgreSQL sees to it by itself")
        put(store, "a", 1)
        files = Path(str(store.engine.url.database)).parent.glob("store.db*")
        assert {path.stat().st_mode & 0o777 for path in files} == {0o600}


class TestUrls:
    @pytest.mark.parametrize("url", ["sqlite://", "sqlite:///:memory:", "mysql://h/d", "no url"])
    def test_what_is_no_durable_store_is_refused(self, url: str) -> None:
        with pytest.raises(StoreError):
            Store.open(url)

    def test_no_server_is_one_sentence_without_the_password(self) -> None:
        with pytest.raises(StoreError, match="cannot be used") as caught:
            Store.open("postgresql://me:geheim@127.0.0.1:1/nowhere")
        assert "geheim" not in str(caught.value)
        assert "\n" not in str(caught.value)

    def test_a_damaged_file_names_the_remedy(self, tmp_path: Path) -> None:
        (tmp_path / "store.db").write_bytes(os.urandom(8192))
        with pytest.raises(StoreError, match="handeye repair"):
            Store.open(f"sqlite:///{tmp_path / 'store.db'}")
