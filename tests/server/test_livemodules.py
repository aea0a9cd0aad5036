"""Modules in memory are what the store says, whatever was done to them, in whatever order, by however many at once."""

from __future__ import annotations

import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from sqlalchemy import select

from handeye.modules.answers import TaughtSamples
from handeye.modules.declaration import ApproximatorSettings, ModuleDeclaration
from handeye.modules.module import Module
from handeye.rpt import NotTaught
from handeye.server.livemodules import LiveModules
from handeye.server.problem import Conflict, NotFound, NotReady, RequestError
from handeye.server.store import Store, tables
from handeye.server.store import modules as stored
from tests.server.rest import declaration

NAME = "map"
DEMONSTRATIONS = ("a-1", "a-2", "b-1", None)
METHODS = ("local_linear", "local_quadratic", "kndb", "nearest")
"""Their answers do not depend on how the tree grew; gradients that are estimated once do."""

Row = tuple[tuple[float, ...], tuple[float, ...], str | None]


def declared(method: str = "local_linear") -> ModuleDeclaration:
    return ModuleDeclaration.model_validate(declaration(NAME, category=True, method=method, neighbours=5))


def rows_of(count: int, seed: int) -> list[Row]:
    random = np.random.default_rng(seed)
    return [
        (
            (float(random.integers(2)), *random.normal(size=2).tolist()),
            tuple(random.normal(size=2).tolist()),
            DEMONSTRATIONS[random.integers(len(DEMONSTRATIONS))],
        )
        for _ in range(count)
    ]


def built(declaration: ModuleDeclaration, rows: dict[int, Row], size: int) -> Module:
    """A module made of these samples at once."""
    numbers = sorted(rows)
    return Module.restored(
        declaration,
        TaughtSamples(
            np.array(numbers, np.int64),
            np.array([rows[n][0] for n in numbers]).reshape(len(numbers), 3),
            np.array([rows[n][1] for n in numbers]).reshape(len(numbers), 2),
            [rows[n][2] for n in numbers],
        ),
        size,
    )


def in_store(store: Store) -> tuple[ModuleDeclaration, dict[int, Row], int]:
    with store.read() as connection:
        module = stored.get(connection, NAME)
        assert module is not None
        rows = {
            number: (tuple(given), tuple(wanted), shown)
            for piece in stored.read_samples(connection, module)
            for number, given, wanted, shown in zip(
                piece.numbers.tolist(), piece.inputs.tolist(), piece.outputs.tolist(), piece.demonstrations, strict=True
            )
        }
    return module.declaration, rows, module.size


def said(module: Module, query: tuple[float, ...]) -> Any:
    """An answer to the last bit, without what depends on when the module was calibrated."""
    try:
        answer = module.answer(query)
    except NotTaught:
        return None
    near = [(n.sample_id, n.demonstration, n.distance, n.weight) for n in answer.neighbours]
    return answer.output.tolist(), near


QUERIES = [(float(part), *place) for part in (0, 1) for place in np.random.default_rng(5).normal(size=(4, 2)).tolist()]


def assert_same(one: Module, other: Module) -> None:
    assert one.samples == other.samples
    assert one.declaration == other.declaration
    for query in QUERIES:
        assert said(one, query) == said(other, query)


# --- one after the other --------------------------------------------------------------------------------------------


@dataclass
class Known:
    """What a module is expected to be."""

    declaration: ModuleDeclaration
    rows: dict[int, Row] = field(default_factory=dict)
    size: int = 0
    snapshots: dict[str, tuple[ModuleDeclaration, dict[int, Row]]] = field(default_factory=dict)

    def erase(self, demonstration: str) -> None:
        """The demonstration is deleted: its samples are gone from the module and its snapshots."""
        for rows in (self.rows, *(rows for _, rows in self.snapshots.values())):
            for number in [number for number, row in rows.items() if row[2] == demonstration]:
                del rows[number]


class Lives(RuleBasedStateMachine):
    """A live module beside a plain dictionary."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp())
        self.store = Store.open(f"sqlite:///{self.folder / 'handeye.db'}")
        self.modules = LiveModules(self.store)
        self.modules.load()
        self.known = Known(declared())

    def teardown(self) -> None:
        self.store.close()
        shutil.rmtree(self.folder)

    @initialize()
    def create(self) -> None:
        self.modules.create(declared())

    @rule(count=st.integers(1, 12), seed=st.integers(0, 2**32 - 1))
    def add(self, count: int, seed: int) -> None:
        rows = rows_of(count, seed)
        first = self.modules.add(NAME, *map(list, zip(*rows, strict=True)))
        assert first == self.known.size
        self.known.rows |= dict(enumerate(rows, first))
        self.known.size += count

    @precondition(lambda self: self.known.rows)
    @rule(data=st.data())
    def remove(self, data: st.DataObject) -> None:
        numbers = data.draw(st.lists(st.sampled_from(sorted(self.known.rows)), min_size=1, max_size=8))
        assert self.modules.remove(NAME, numbers) == len(set(numbers))
        for number in set(numbers):
            del self.known.rows[number]

    @rule(number=st.integers(0, 60))
    def remove_what_may_not_be_there(self, number: int) -> None:
        if number in self.known.rows:
            assert self.modules.remove(NAME, [number]) == 1
            del self.known.rows[number]
        else:
            with pytest.raises(NotFound):
                self.modules.remove(NAME, [number, *list(self.known.rows)[:1]])

    @rule(demonstration=st.sampled_from([name for name in DEMONSTRATIONS if name]), everywhere=st.booleans())
    def untrain(self, demonstration: str, everywhere: bool) -> None:
        if everywhere:
            self.modules.forget_demonstration(demonstration)
            self.known.erase(demonstration)
            return
        gone = [number for number, row in self.known.rows.items() if row[2] == demonstration]
        if gone:
            assert self.modules.untrain(NAME, demonstration) == len(gone)
        else:
            with pytest.raises(NotFound):
                self.modules.untrain(NAME, demonstration)
        for number in gone:
            del self.known.rows[number]

    @rule(name=st.sampled_from("xyz"))
    def snapshot(self, name: str) -> None:
        if name in self.known.snapshots:
            with pytest.raises(Conflict):
                self.modules.snapshot(NAME, name)
        else:
            assert self.modules.snapshot(NAME, name).samples == len(self.known.rows)
            self.known.snapshots[name] = self.known.declaration, dict(self.known.rows)

    @precondition(lambda self: self.known.snapshots)
    @rule(data=st.data())
    def roll_back(self, data: st.DataObject) -> None:
        name = data.draw(st.sampled_from(sorted(self.known.snapshots)))
        self.modules.roll_back(NAME, name)
        declaration, rows = self.known.snapshots[name]
        self.known.declaration, self.known.rows = declaration, dict(rows)
        self.is_fresh()

    @precondition(lambda self: self.known.snapshots)
    @rule(data=st.data())
    def drop_snapshot(self, data: st.DataObject) -> None:
        name = data.draw(st.sampled_from(sorted(self.known.snapshots)))
        self.modules.drop_snapshot(NAME, name)
        del self.known.snapshots[name]

    @rule(do=st.sampled_from([LiveModules.roll_back, LiveModules.drop_snapshot]))
    def ask_for_a_snapshot_that_is_not_there(self, do: Callable[[LiveModules, str, str], object]) -> None:
        with pytest.raises(NotFound):
            do(self.modules, NAME, "other")

    @rule(method=st.sampled_from([None, *METHODS]))
    def retrain(self, method: str | None) -> None:
        approximator = None
        if method is not None:
            self.known.declaration = declared(method)
            approximator = self.known.declaration.approximator
        self.modules.retrain(NAME, approximator)
        self.is_fresh()

    @rule(count=st.integers(1, 8), seed=st.integers(0, 2**32 - 1), method=st.sampled_from(METHODS))
    def replace(self, count: int, seed: int, method: str) -> None:
        rows = rows_of(count, seed)
        self.known.declaration = declared(method)
        self.modules.replace(self.known.declaration, *map(list, zip(*rows, strict=True)))
        self.known.rows = dict(enumerate(rows, self.known.size))
        self.known.size += count
        self.is_fresh()

    @rule()
    def start_anew(self) -> None:
        self.modules = LiveModules(self.store)
        with pytest.raises(NotReady):
            self.modules.live(NAME)
        self.modules.load()
        self.is_fresh()

    @precondition(lambda self: self.known.size > 60)
    @rule()
    def delete(self) -> None:
        self.modules.delete(NAME)
        with pytest.raises(NotFound):
            self.modules.live(NAME)
        self.modules.create(declared())
        self.known = Known(declared())

    @rule(count=st.integers(1, 4), seed=st.integers(0, 2**32 - 1))
    def undo(self, count: int, seed: int) -> None:
        """A transaction that is given up leaves nothing behind."""
        rows = rows_of(count, seed)

        def fail() -> None:
            with self.store.write():
                self.modules.add(NAME, *map(list, zip(*rows, strict=True)))
                self.modules.forget_demonstration("a-1")
                self.modules.snapshot(NAME, "undone")
                raise ZeroDivisionError

        with pytest.raises(ZeroDivisionError):
            fail()

    @rule(count=st.integers(1, 4), seed=st.integers(0, 2**32 - 1))
    def several_at_once(self, count: int, seed: int) -> None:
        """In one transaction: what comes later knows what came before."""
        rows = rows_of(count, seed)
        with self.store.write():
            first = self.modules.add(NAME, *map(list, zip(*rows, strict=True)))
            self.modules.retrain(NAME, None)
            self.modules.remove(NAME, [first])
            self.modules.forget_demonstration("b-1")
        self.known.rows |= dict(enumerate(rows, first))
        self.known.size += count
        del self.known.rows[first]
        self.known.erase("b-1")

    def is_fresh(self) -> None:
        """Support and expected errors too are those of a module that is made of the samples at once."""
        live, fresh = self.modules.live(NAME), built(self.known.declaration, self.known.rows, self.known.size)
        for query in QUERIES:
            if said(fresh, query) is not None:
                one, other = live.answers([query]), fresh.answers([query])
                assert one.support.tolist() == other.support.tolist()
                assert one.expected_error.tolist() == other.expected_error.tolist()
        assert [repr(each) for each in live.statistics()] == [repr(each) for each in fresh.statistics()]

    @invariant()
    def live_and_stored_are_as_expected(self) -> None:
        known = self.known
        assert in_store(self.store) == (known.declaration, known.rows, known.size)
        assert_same(self.modules.live(NAME), built(known.declaration, known.rows, known.size))
        listed = {each.name: each.samples for each in self.modules.snapshots(NAME)}
        assert listed == {name: len(rows) for name, (_, rows) in known.snapshots.items()}
        # What neither the module nor a snapshot has takes no room.
        with self.store.read() as connection:
            kept = set(connection.execute(select(tables.samples.c.number)).scalars())
        assert kept == set(known.rows).union(*(rows for _, rows in known.snapshots.values()))


TestLives = Lives.TestCase
TestLives.settings = settings(
    max_examples=30, stateful_step_count=40, deadline=None, suppress_health_check=list(HealthCheck)
)


# --- all at once ----------------------------------------------------------------------------------------------------


def test_many_at_once_leave_memory_as_the_store_is(store: Store) -> None:
    modules = LiveModules(store)
    modules.load()
    modules.create(declared())
    stop, errors = threading.Event(), list[BaseException]()
    deadline = time.monotonic() + 3.0

    def again(work: Callable[[np.random.Generator], object], seed: int) -> None:
        random = np.random.default_rng(seed)
        try:
            while not stop.is_set() and time.monotonic() < deadline:
                with suppress(RequestError, NotTaught):  # somebody else was quicker
                    work(random)
        except BaseException as error:
            errors.append(error)
            stop.set()

    def add(random: np.random.Generator) -> None:
        rows = rows_of(int(random.integers(1, 30)), int(random.integers(2**32)))
        modules.add(NAME, *map(list, zip(*rows, strict=True)))

    def remove(random: np.random.Generator) -> None:
        numbers = list(in_store(store)[1])
        modules.remove(NAME, random.choice(numbers, min(5, len(numbers)), replace=False).tolist() if numbers else [0])

    def ask(_random: np.random.Generator) -> None:
        module = modules.live(NAME)
        answers = module.answers(QUERIES)
        assert np.isfinite(answers.outputs).all()
        assert answers.demonstrations.max(initial=-1) < len(answers.names)
        module.statistics()

    def retrain(random: np.random.Generator) -> None:
        method = METHODS[random.integers(len(METHODS))]
        modules.retrain(NAME, ApproximatorSettings.model_validate({"method": method, "neighbours": 5}))

    def remember(random: np.random.Generator) -> None:
        name = "xyz"[random.integers(3)]
        (modules.snapshot, modules.roll_back, modules.drop_snapshot)[random.integers(3)](NAME, name)
        time.sleep(0.02)

    def untrain(_random: np.random.Generator) -> None:
        modules.forget_demonstration("a-1")
        time.sleep(0.05)

    works = [add, add, add, remove, remove, ask, ask, ask, retrain, remember, untrain]
    threads = [threading.Thread(target=again, args=(work, seed)) for seed, work in enumerate(works)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30.0)
    assert errors == []
    assert not any(thread.is_alive() for thread in threads)
    declaration, rows, size = in_store(store)
    assert rows
    assert_same(modules.live(NAME), built(declaration, rows, size))
    fresh = LiveModules(store)
    fresh.load()
    assert_same(modules.live(NAME), fresh.live(NAME))
