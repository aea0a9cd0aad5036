from __future__ import annotations

import sys
import threading
import time

import numpy as np
import pytest

from handeye.server.store import Store, modules
from handeye.server.store.check import verify
from handeye.server.store.repair import repair
from tests.server.store.killing import DECLARATION, Batch, check, kill_while_it_writes, samples_of
from tests.server.store.postgres import running_postgres
from tests.server.store.soak import KILLS, rounds


def writer(url: str, first_batch: int) -> list[str]:
    return [sys.executable, "-m", "tests.server.store.writer", url, str(first_batch)]


class TestKilledWriter:
    @pytest.mark.timeout(60 + 10 * KILLS)
    def test_all_that_was_acknowledged_is_there_once(self, url: str) -> None:
        random = np.random.default_rng(1)
        for kill in range(KILLS):
            if kill % 5 == 0:
                # Not ever more samples: each kill is followed by a look at them all.
                with Store.open(url) as store, store.write() as connection:
                    modules.drop(connection, DECLARATION.name)
                acknowledged: list[Batch] = []
            # The batch that was under way was perhaps written: its number is not taken again.
            first = acknowledged[-1].number + 2 if acknowledged else 0
            acknowledged += kill_while_it_writes(writer(url, first), float(random.uniform(0.0, 0.4)))
            check(url, acknowledged)


class TestKilledDatabase:
    @pytest.mark.timeout(60 + 20 * KILLS)
    def test_all_that_was_acknowledged_is_there_once(self) -> None:
        random = np.random.default_rng(2)
        with running_postgres(durable=True) as server:
            url = server.make_database()
            with Store.open(url) as store, store.write() as connection:
                modules.create(connection, DECLARATION)
            acknowledged: list[Batch] = []
            for _ in range(rounds(2)):
                first = acknowledged[-1].number + 2 if acknowledged else 0
                killer = threading.Timer(float(random.uniform(0.1, 0.5)), server.kill)
                acknowledged += write_until_it_fails(url, first, killer)
                server.start()
                check(url, acknowledged)
            assert acknowledged


def write_until_it_fails(url: str, number: int, killer: threading.Timer) -> list[Batch]:
    """Writes batches until the database is gone, which `killer` sees to after the first one."""
    acknowledged: list[Batch] = []
    store = Store.open(url)
    try:
        while True:
            with store.write() as connection:
                first = modules.add_samples(connection, DECLARATION.name, *samples_of(number, 50), [None] * 50)
            acknowledged.append(Batch(number, 50, first))
            number += 1
            if len(acknowledged) == 1:
                killer.start()
    except Exception:
        killer.join()
        return acknowledged
    finally:
        store.close()


class TestManySamples:
    def test_a_hundred_thousand_are_looked_at_and_mended_in_seconds(self, sqlite_url: str) -> None:
        with Store.open(sqlite_url) as store, store.write() as connection:
            modules.create(connection, DECLARATION)
            modules.add_samples(connection, DECLARATION.name, *samples_of(0, 100_000), ["shown-1"] * 100_000)
        started = time.monotonic()
        assert verify(sqlite_url) == []
        seconds = time.monotonic() - started
        path = sqlite_url.removeprefix("sqlite:///")
        with open(path, "r+b") as file:
            file.seek(5_000_000)
            byte = file.read(1)
            file.seek(5_000_000)
            file.write(bytes([byte[0] ^ 0x10]))
        repair(sqlite_url)
        assert check(sqlite_url, [Batch(0, 100_000, 0)]) == 100_000
        # No measurement: a machine that does other things too may take ten times as long as it needs.
        assert seconds < 40.0
