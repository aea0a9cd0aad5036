"""Real damage to SQLite files: it is found, what is whole is saved, the rest is set aside."""

from __future__ import annotations

import base64
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import delete, select

from handeye.server.store import Store, StoreError, modules
from handeye.server.store.check import verify
from handeye.server.store.repair import Report, repair
from handeye.server.store.rows import loads
from handeye.server.store.tables import jobs, metadata, samples
from tests.server.store.example import DECLARATION, contents
from tests.server.store.soak import rounds

pytestmark = pytest.mark.timeout(rounds(120))

PAGE = 4096
Contents = dict[str, dict[tuple[Any, ...], dict[str, Any]]]


class File:
    """A store's file, and what is to be in it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.url = f"sqlite:///{path}"
        self.whole = path.read_bytes()
        self.wanted = self.read()
        self.raw = self.read_raw()

    def write(self, content: bytes | bytearray) -> None:
        """Puts a damaged content in its place."""
        self.clear()
        self.path.write_bytes(content)

    def clear(self) -> None:
        for path in self.path.parent.glob(f"{self.path.name}*"):
            path.unlink()

    def read(self) -> Contents:
        with Store.open(self.url) as store, store.read() as connection:
            return contents(connection)

    def read_raw(self) -> Any:
        """Whatever SQLite reads, without a check of ours."""
        try:
            with closing(sqlite3.connect(f"file:{self.path}?mode=ro", uri=True)) as connection:
                return [connection.execute(f'SELECT * FROM "{table}"').fetchall() for table in metadata.tables]
        except (sqlite3.Error, UnicodeDecodeError):
            return None

    def check(self) -> list[Any]:
        """Repairs it; then it is well, and has no row that was not there. Returns the keys of those that are gone."""
        if self.read_raw() != self.raw:
            assert verify(self.url), "damage was not noticed"
        repair(self.url)
        assert verify(self.url) == []
        found = self.read()
        lost = []
        for table, rows in self.wanted.items():
            if table in ("set_aside", "snapshots"):
                continue  # a snapshot loses the samples that are lost
            assert found[table].keys() <= rows.keys(), f"rows of {table} came from nowhere"
            lost += [(table, *key) for key, row in rows.items() if found[table].get(key) != row]
        if lost:
            aside = found["set_aside"].keys() - self.wanted["set_aside"].keys()
            assert aside, f"{lost} were dropped silently"
        return lost


@pytest.fixture
def file(sqlite_example: Path, tmp_path: Path) -> File:
    path = tmp_path / "store.db"
    shutil.copy(sqlite_example, path)
    return File(path)


class TestFlippedBytes:
    def test_one_anywhere_costs_at_most_a_large_row(self, file: File) -> None:
        random = np.random.default_rng(1)
        for _ in range(rounds(40)):
            place, change = random.integers(len(file.whole)), random.integers(1, 256)
            damaged = bytearray(file.whole)
            damaged[place] ^= change
            file.write(damaged)
            lost = file.check()
            # A byte is put right in any row that is not large, so that its checksum says which one.
            assert len(lost) <= 1, (place, change, lost)
            assert all(table in ("object_pictures", "look_pictures") for table, *_ in lost), (place, change, lost)

    def test_ten_cost_at_most_ten_rows(self, file: File) -> None:
        random = np.random.default_rng(2)
        for _ in range(rounds(10)):
            damaged = bytearray(file.whole)
            for place in random.integers(len(file.whole), size=10):
                damaged[place] ^= random.integers(1, 256)
            file.write(damaged)
            assert len(file.check()) <= 10

    def test_in_the_header(self, file: File) -> None:
        for place in range(0, 100, 1 if rounds(1) > 1 else 7):
            damaged = bytearray(file.whole)
            damaged[place] ^= 0x41
            file.write(damaged)
            assert file.check() == [], place


class TestLostPages:
    def test_any_page_may_be_empty(self, file: File) -> None:
        for number in range(0, len(file.whole) // PAGE, 1 if rounds(1) > 1 else 5):
            damaged = bytearray(file.whole)
            damaged[number * PAGE : (number + 1) * PAGE] = bytes(PAGE)
            file.write(damaged)
            file.check()

    def test_the_first_one_holds_nothing_that_is_missed(self, file: File) -> None:
        file.write(bytes(PAGE) + file.whole[PAGE:])
        assert file.check() == []

    def test_of_samples_it_is_said_which_are_lost(self, file: File) -> None:
        place = file.whole.index(file.wanted["samples"][("reach", 150)]["input"]) // PAGE * PAGE
        file.write(file.whole[:place] + bytes(PAGE) + file.whole[place + PAGE :])
        lost = {f"{module}/{number}" for table, module, number in file.check() if table == "samples"}
        assert len(lost) > 10
        aside = {row["row_key"]: row["reason"] for row in file.read()["set_aside"].values() if row["row_key"] in lost}
        assert aside == dict.fromkeys(lost, "it could not be read any more; an index still names it")

    def test_a_sector_of_garbage(self, file: File) -> None:
        random = np.random.default_rng(3)
        for _ in range(rounds(10)):
            place = random.integers(len(file.whole) // 512) * 512
            file.write(file.whole[:place] + random.bytes(512) + file.whole[place + 512 :])
            file.check()

    def test_a_file_that_was_cut_off(self, file: File) -> None:
        random = np.random.default_rng(4)
        for place in random.integers(10 * PAGE, len(file.whole), size=rounds(8)):
            file.write(file.whole[:place])
            file.check()

    def test_what_was_deleted_does_not_come_back(self, file: File) -> None:
        with Store.open(file.url) as store, store.write() as connection:
            connection.execute(delete(samples).where(samples.c.module == "reach", samples.c.number % 3 > 0))
            connection.execute(delete(jobs).where(jobs.c.number < 5))
        file.whole = file.path.read_bytes()
        file.wanted = file.read()
        file.raw = file.read_raw()
        for number in range(0, len(file.whole) // PAGE, 9):
            file.write(bytes(PAGE) + file.whole[PAGE : number * PAGE] + bytes(PAGE) + file.whole[(number + 1) * PAGE :])
            file.check()


class TestTheOriginal:
    @pytest.fixture
    def damaged(self, file: File) -> bytes:
        """What stands in the file: a byte has changed in a row that is too large to be put right."""
        content = bytearray(file.whole)
        content[file.whole.index(file.wanted["object_pictures"][("blue cup", 1)]["left_image"][-200:])] ^= 0xFF
        file.write(content)
        return bytes(content)

    def test_is_kept_and_nothing_else_is_left(self, file: File, damaged: bytes) -> None:
        file.path.chmod(0o640)
        report = repair(file.url)
        assert report.original is not None
        assert report.original.read_bytes() == damaged
        assert file.path.stat().st_mode & 0o777 == 0o640
        others = {path.name for path in file.path.parent.iterdir()} - {file.path.name, report.original.name}
        assert others <= {f"{file.path.name}{suffix}" for suffix in ("-wal", "-shm", ".lock")}
        row = next(row for row in file.read()["set_aside"].values() if row["of_table"] == "object_pictures")
        assert row["row_key"] == "blue cup/1"
        left = base64.b64decode(loads(row["content"])["left_image"]["base64"])
        assert left != file.wanted["object_pictures"][("blue cup", 1)]["left_image"]

    def test_a_second_one_of_the_same_second_too(self, file: File, damaged: bytes) -> None:
        first = repair(file.url).original
        file.path.write_bytes(damaged)
        second = repair(file.url).original
        assert first is not None
        assert second is not None
        assert first != second

    def test_what_is_no_store_is_left_alone(self, file: File) -> None:
        content = np.random.default_rng(5).bytes(20 * PAGE)
        file.write(content)
        with pytest.raises(StoreError, match="nothing of a store can be found in the file; nothing was changed"):
            repair(file.url)
        assert file.path.read_bytes() == content
        assert {path.name for path in file.path.parent.iterdir()} == {file.path.name, f"{file.path.name}.lock"}

    def test_nor_is_an_empty_file(self, file: File) -> None:
        file.write(b"")
        for work in (verify, repair):
            with pytest.raises(StoreError, match="is an empty file"):
                work(file.url)

    def test_another_version_is_left_to_its_handeye(self, file: File) -> None:
        with closing(sqlite3.connect(file.path)) as connection:
            connection.execute("UPDATE alembic_version SET version_num = '0007'")
            connection.commit()
        content = bytearray(file.path.read_bytes())
        content[16] ^= 0x40  # a page's size
        file.write(content)
        with pytest.raises(StoreError, match="the store is of version '0007'"):
            repair(file.url)
        assert file.path.read_bytes() == content

    @pytest.mark.parametrize("step", range(2))
    def test_interrupted_while_it_is_replaced_nothing_is_lost(
        self, log: LogFile, monkeypatch: pytest.MonkeyPatch, step: int
    ) -> None:
        log.damage(len(log.content) // 2)
        replace, done = Path.replace, [0]

        def failing(path: Path, target: Path) -> Path:
            if done[0] == step:
                raise OSError("the power fails")
            done[0] += 1
            return replace(path, target)

        with monkeypatch.context() as patched:
            patched.setattr(Path, "replace", failing)
            with pytest.raises(OSError, match="the power fails"):
                repair(log.url)
        repair(log.url)
        assert verify(log.url) == []
        assert log.numbers() == list(range(log.acknowledged[-1][1]))


class LogFile:
    """A store as it is when its process is killed: the newest batches are in the write-ahead log only."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "store.db"
        self.url = f"sqlite:///{self.path}"
        self.log = Path(f"{self.path}-wal")
        self.acknowledged: list[tuple[int, int]] = []
        """After each batch: bytes in the log, samples in the store."""
        random = np.random.default_rng(6)
        live = folder / "live.db"
        with Store.open(f"sqlite:///{live}") as store:
            with store.write() as connection:
                modules.create(connection, DECLARATION)
            with closing(sqlite3.connect(live)) as other:
                other.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            total = 0
            for _ in range(40):
                size = int(random.integers(1, 40))
                with store.write() as connection:
                    values = random.normal(size=(size, 10))
                    modules.add_samples(connection, "reach", values[:, :4], values[:, 4:], ["grasp-1"] * size)
                total += size
                self.acknowledged.append((Path(f"{live}-wal").stat().st_size, total))
            shutil.copy(live, self.path)
            shutil.copy(f"{live}-wal", self.log)
        self.main = self.path.read_bytes()
        self.content = self.log.read_bytes()

    def write(self, content: bytes | bytearray) -> None:
        """Puts another log beside the file as it was."""
        for path in self.path.parent.glob("store.db*"):
            path.unlink()
        self.path.write_bytes(self.main)
        self.log.write_bytes(content)

    def damage(self, place: int) -> None:
        content = bytearray(self.content)
        content[place] ^= 0x24
        self.write(content)

    def numbers(self) -> list[int]:
        with Store.open(self.url) as store, store.read() as connection:
            return list(connection.execute(select(samples.c.number).order_by(samples.c.number)).scalars())


@pytest.fixture
def log(tmp_path: Path) -> LogFile:
    return LogFile(tmp_path)


class TestLog:
    def test_torn_anywhere_it_has_all_that_was_acknowledged(self, log: LogFile) -> None:
        random = np.random.default_rng(7)
        for place in random.integers(len(log.content), size=rounds(30)):
            log.write(log.content[:place])
            assert verify(log.url) == []
            assert repair(log.url) == Report((), None)
            wanted = max((total for size, total in log.acknowledged if size <= place), default=0)
            assert log.numbers() == list(range(wanted))

    def test_with_garbage_at_its_end_too(self, log: LogFile) -> None:
        random = np.random.default_rng(8)
        for place in random.integers(len(log.content), size=rounds(5)):
            log.write(log.content[:place] + random.bytes(3 * PAGE))
            assert verify(log.url) == []
            wanted = max((total for size, total in log.acknowledged if size <= place), default=0)
            assert log.numbers() == list(range(wanted))

    def test_damaged_in_its_midst_it_gives_what_sqlite_does_not_see(self, log: LogFile) -> None:
        random = np.random.default_rng(9)
        # Damage in the last two transactions looks like their torn end.
        safe = log.acknowledged[-3][0]
        for place in [5, 20, *random.integers(32, safe, size=rounds(15)).tolist()]:
            log.damage(place)
            assert "its write-ahead log is damaged" in str(verify(log.url)[0])
            report = repair(log.url)
            assert report.original is not None
            assert Path(f"{report.original}-wal").exists()
            assert verify(log.url) == []
            assert log.numbers() == list(range(log.acknowledged[-1][1]))

    def test_one_that_was_begun_anew_is_well(self, log: LogFile) -> None:
        with closing(sqlite3.connect(log.path)) as connection:
            connection.execute("PRAGMA wal_checkpoint(RESTART)")
            connection.execute("UPDATE modules SET created = created")
            connection.commit()
            assert verify(log.url) == []
            leftovers = len(log.content) - log.log.stat().st_size
            assert leftovers == 0
