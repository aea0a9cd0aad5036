from __future__ import annotations

import shutil
import sqlite3
import threading
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import delete, func, insert, select

from handeye.server.store import Store, StoreError, counters, modules, rows, upgrade
from handeye.server.store.backup import BackupError, backup, restore
from handeye.server.store.check import verify
from handeye.server.store.findings import entry
from handeye.server.store.tables import counters as counters_table
from handeye.server.store.tables import modules as modules_table
from handeye.server.store.tables import samples, set_aside, tokens
from tests.server.store.example import FREE, contents


def read(store: Store) -> dict[str, Any]:
    with store.read() as connection:
        return contents(connection)


@pytest.fixture
def copy(filled: str, tmp_path: Path) -> Path:
    """A backup of a store with rows of every kind, from each kind of database."""
    with Store.open(filled) as store:
        backup(store, tmp_path / "copy.db")
    return tmp_path / "copy.db"


class TestBackup:
    def test_is_a_store_in_one_file(self, filled: str, copy: Path) -> None:
        assert verify(f"sqlite:///{copy}") == []
        assert copy.stat().st_mode & 0o777 == 0o600
        with Store.open(filled) as store:
            wanted = read(store)
        alone = copy.parent / "alone"
        alone.mkdir()
        shutil.copy(copy, alone / "store.db")
        with Store.open(f"sqlite:///{alone / 'store.db'}") as store:
            assert read(store) == wanted

    def test_replaces_what_was_there(self, filled: str, tmp_path: Path) -> None:
        path = tmp_path / "copy.db"
        path.write_bytes(b"something else")
        with Store.open(filled) as store:
            backup(store, path)
        assert verify(f"sqlite:///{path}") == []
        assert {each.name for each in tmp_path.glob(".*")} == set()

    def test_where_it_cannot_be_written_it_says_so(self, filled: str, tmp_path: Path) -> None:
        with Store.open(filled) as store, pytest.raises(StoreError, match="cannot be backed up to"):
            backup(store, tmp_path / "nowhere" / "copy.db")

    def test_shows_one_moment_while_others_write(self, url: str, tmp_path: Path) -> None:
        done = threading.Event()
        with Store.open(url) as store:
            with store.write() as connection:
                modules.create(connection, FREE)

            def write() -> None:
                while not done.is_set():
                    with store.write() as connection:
                        modules.add_samples(connection, "free", np.zeros((7, 4)), np.zeros((7, 6)), [None] * 7)
                        rows.put(
                            connection, counters_table, name="batches", next=modules.count(connection, "free") // 7
                        )

            writer = threading.Thread(target=write)
            writer.start()
            try:
                sizes = []
                for number in range(6):
                    path = tmp_path / f"copy{number}.db"
                    backup(store, path)
                    assert verify(f"sqlite:///{path}") == []
                    with closing(sqlite3.connect(path)) as copied:
                        [batches] = copied.execute("SELECT max(next) FROM counters").fetchone()
                        [count] = copied.execute("SELECT count(*) FROM samples").fetchone()
                    assert count == 7 * (batches or 0)
                    sizes.append(count)
            finally:
                done.set()
                writer.join()
        assert sizes == sorted(sizes)
        assert sizes[-1] > sizes[0]


class TestRestore:
    def test_brings_everything_back(self, copy: Path, filled: str, url: str) -> None:
        with Store.open(filled) as store:
            wanted = read(store)
        with Store.open(url) as store:
            with store.write() as connection:
                modules.create(connection, FREE)
                modules.add_samples(connection, "free", np.ones((60, 4)), np.ones((60, 6)), [None] * 60)
                counters.take(connection, "demonstrations/pour")
            restore(store, copy)
            found = read(store)
        assert verify(url) == []
        for name in wanted.keys() - {"tokens", "set_aside", "counters", "modules"}:
            assert found[name] == wanted[name]
        assert found["modules"].keys() == wanted["modules"].keys()
        assert found["set_aside"] == wanted["set_aside"]
        # Numbers are never given twice: the present store had given 60 of this module.
        assert found["modules"][("free",)]["next_number"] == 60
        assert {name: row["next"] for (name,), row in found["counters"].items()} == {
            "jobs": 9,
            "demonstrations/grasp": 5,
            "demonstrations/pour": 2,
        }

    def test_keeps_tokens_and_what_was_set_aside(self, copy: Path, url: str) -> None:
        token = {"id": "t2", "name": "mine", "role": "viewer", "digest": "cd" * 32, "created": 1.0, "expires": None}
        with Store.open(url) as store:
            with store.write() as connection:
                rows.add(connection, tokens, **token)
                connection.execute(insert(set_aside), entry("samples", "m/1", "found here", {}))
            restore(store, copy)
            restore(store, copy)
            found = read(store)
        assert set(found["tokens"]) == {("t2",)}
        assert {row["reason"] for row in found["set_aside"].values()} == {"found here", "found before"}

    def test_is_one_write(self, copy: Path, url: str) -> None:
        called = []
        with Store.open(url) as store:
            with store.write():
                restore(store, copy)
                store.afterwards(lambda: called.append(len(read(store)["samples"])))
                assert called == []
            assert called == [350]

    @pytest.mark.parametrize(
        ("content", "problem"),
        [
            (b"", "the backup is empty"),
            (b"no database" * 1000, "the backup is none, or damaged where it begins"),
            (None, "has none of its tables"),
        ],
    )
    def test_refuses_what_is_no_backup(self, filled: str, tmp_path: Path, content: bytes | None, problem: str) -> None:
        path = tmp_path / "other.db"
        if content is None:
            with closing(sqlite3.connect(path)) as connection:
                connection.execute("CREATE TABLE other (a)")
                connection.commit()
        else:
            path.write_bytes(content)
        self.refuse(filled, path, problem)

    def test_refuses_a_damaged_one(self, copy: Path, filled: str) -> None:
        content = bytearray(copy.read_bytes())
        with closing(sqlite3.connect(copy)) as connection:
            [value] = connection.execute("SELECT input FROM samples WHERE module = 'reach' AND number = 50").fetchone()
        content[content.index(value)] ^= 0xFF
        copy.write_bytes(content)
        self.refuse(
            filled, copy, r"the backup is damaged \(samples reach/50: its checksum does not fit.*handeye repair"
        )

    def test_refuses_one_from_the_future(self, copy: Path, filled: str) -> None:
        with closing(sqlite3.connect(copy)) as connection:
            connection.execute("UPDATE alembic_version SET version_num = '9999'")
            connection.commit()
        self.refuse(filled, copy, "the backup is of version '9999', which this handeye does not know")

    @staticmethod
    def refuse(url: str, path: Path, problem: str) -> None:
        with Store.open(url) as store:
            before = read(store)
            with pytest.raises(BackupError, match=problem):
                restore(store, path)
            assert read(store) == before
        assert {each.name for each in path.parent.glob(".*")} == set()

    def test_brings_an_older_one_up_to_date_first(
        self, copy: Path, sqlite_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        migrations = tmp_path / "migrations"
        shutil.copytree(Path(upgrade.__file__).parent / "migrations", migrations)
        (migrations / "versions" / "0002_second.py").write_text(
            f'from alembic import op\nrevision = "0002"\ndown_revision = "{upgrade.newest()}"\n'
            'def upgrade():\n    op.execute("DELETE FROM replies")\n'
        )
        monkeypatch.setattr(upgrade, "_FOLDER", migrations)
        before = copy.read_bytes()
        with Store.open(sqlite_url) as store:
            restore(store, copy)
            found = read(store)
        assert found["replies"] == {}
        assert len(found["samples"]) == 350
        assert copy.read_bytes() == before

    def test_undoes_all_when_the_caller_fails(self, copy: Path, filled: str) -> None:
        with Store.open(filled) as store:
            with store.write() as connection:
                connection.execute(delete(samples))
                connection.execute(delete(modules_table))
            with pytest.raises(ZeroDivisionError):
                self.restore_and_fail(store, copy)
            with store.read() as connection:
                assert connection.execute(select(func.count()).select_from(samples)).scalar() == 0

    @staticmethod
    def restore_and_fail(store: Store, path: Path) -> None:
        with store.write():
            restore(store, path)
            raise ZeroDivisionError
