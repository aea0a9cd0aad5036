"""Searches beside a writer: each answers for the samples that had come when it began."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import pytest

from handeye import rpt
from handeye.rpt.kernels import insert, layout, search
from handeye.rpt.kernels.lanes import LANES
from tests.learner.forms import JIT_OFF, Floats, brute_force, scan_nothing

READERS = 3
SAMPLES = 360 if JIT_OFF else 3000
K = 5


@pytest.fixture(autouse=True)
def threads_take_turns_often() -> Iterator[None]:
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(interval)


class Seen(NamedTuple):
    """What a search returned, between how many and how many steps of the writer."""

    least: int
    most: int
    kind: int
    numbers: list[list[int]]
    distances: list[list[float]]


class Writer:
    """Steps that have certainly been taken, and those that may have been."""

    def __init__(self, steps: list[Callable[[], object]]) -> None:
        self.steps, self.begun, self.done = steps, 0, 0

    def run(self) -> None:
        for step in self.steps:
            self.begun += 1
            step()
            self.done += 1


def watch(writer: Writer, searches: list[Callable[[], rpt.Neighbours]], most: int = 400) -> list[Seen]:
    """Runs the writer, and readers beside it until it is done."""
    ready = threading.Barrier(READERS + 1)
    finished = threading.Event()

    def read(reader: int) -> list[Seen]:
        seen: list[Seen] = []
        ready.wait(timeout=20)
        while not finished.is_set() or len(seen) < len(searches):
            kind = (len(seen) + reader) % len(searches)
            least = writer.done
            ids, distances = searches[kind]()
            seen.append(Seen(least, writer.begun, kind, ids.tolist(), distances.tolist()))
        return seen

    with ThreadPoolExecutor(READERS) as pool:
        readers = [pool.submit(read, reader) for reader in range(READERS)]
        ready.wait(timeout=20)
        try:
            writer.run()
        finally:
            finished.set()
        seen = [one for reader in readers for one in reader.result(timeout=60)]
    # Evenly chosen, and some of them must have met a writer at work.
    chosen = seen[:: max(1, len(seen) // most)]
    assert {one.least for one in seen} & set(range(1, len(writer.steps)))
    return chosen


def scattered(n: int) -> Floats:
    """Many covered samples, duplicates, and places that become nodes late."""
    rng = np.random.default_rng(1)
    return np.concatenate([rng.integers(-6, 7, size=(n // 2, 2)) / 4, rng.normal(size=(n - n // 2, 2))])[
        rng.permutation(n)
    ]


QUERIES = np.random.default_rng(2).normal(size=(12, 2))


@pytest.mark.parametrize("built", [0, 200, layout.FLAT_LANES + 8])
def test_exact_answers_are_those_of_a_moment_while_samples_come_and_go(built: int) -> None:
    rng = np.random.default_rng(3)
    points = scattered(built + SAMPLES)
    tree = rpt.build(points[:built], radii=[2.0, 0.5])
    if built == 0:
        built = len(tree.insert(points[:K]))
    inserted, removed, living = [built], [-1], list(range(built))
    steps: list[Callable[[], object]] = []
    for i in range(built, len(points)):
        steps.append(lambda i=i: tree.insert(points[i]))  # type: ignore[misc]
        living.append(i)
        inserted.append(i + 1)
        removed.append(-1)
        if i % 5 == 0:
            gone = living.pop(int(rng.integers(len(living))))
            steps.append(lambda gone=gone: tree.remove(gone))  # type: ignore[misc]
            inserted.append(i + 1)
            removed.append(gone)
        if i % 250 == 0:
            steps.append(tree.repair)
            inserted.append(i + 1)
            removed.append(-1)
    for least, most, _, numbers, distances in watch(Writer(steps), [lambda: tree.exact(QUERIES, K)]):
        gone_before = {sample for sample in removed[: least + 1] if sample >= 0}
        going = {sample for sample in removed[least + 1 : most + 1] if sample >= 0}
        # All samples of a batch of queries belong to one moment: its newest sample had come, and all before it.
        size = max(inserted[least], max(map(max, numbers)) + 1)
        assert size <= inserted[most]
        for query, ids, found in zip(QUERIES, numbers, distances, strict=True):
            among = set(range(size)) - gone_before - (going - set(ids))
            expected, distances_expected = brute_force(points, query, K, among)
            # Where samples went during the search there may be fewer than were asked for.
            missing = K - len(expected)
            assert missing <= len(going)
            assert ids == expected + [-1] * missing
            assert found == distances_expected + [np.inf] * missing


@pytest.mark.parametrize("keep", [True, False], ids=["kept", "dropped"])
def test_beams_and_levels_are_those_of_a_moment(keep: bool) -> None:
    points = scattered(SAMPLES // 2)
    radii, built = [2.0, 1.0, 0.4, 0.2], 20

    def searches(tree: rpt.Tree) -> list[Callable[[], rpt.Neighbours]]:
        def at_level() -> rpt.Neighbours:
            return rpt.Neighbours(tree.at_level(QUERIES, 3)[:, np.newaxis], np.zeros((len(QUERIES), 1)))

        return [
            lambda: tree.beam(QUERIES, 3),
            lambda: tree.beam(QUERIES, 2, 9),
            at_level,
            lambda: tree.exact(QUERIES, 4),
        ]

    def steps(tree: rpt.Tree) -> list[Callable[[], object]]:
        insertions: list[Callable[[], object]] = [lambda i=i: tree.insert(points[i]) for i in range(built, len(points))]  # type: ignore[misc]
        for place in range(len(points) - 100, 0, -200):
            insertions.insert(place, tree.repair)
        return insertions

    tree = scan_nothing(rpt.build(points[:built], radii=radii, keep_covered=keep))
    seen = watch(Writer(steps(tree)), searches(tree))
    # The same again, alone, after each step.
    again = scan_nothing(rpt.build(points[:built], radii=radii, keep_covered=keep))
    alone = searches(again)
    moments = []
    for step in [lambda: None, *steps(again)]:
        step()
        moments.append([tuple(part.tolist() for part in run()) for run in alone])
    for least, most, kind, numbers, distances in seen:
        assert (numbers, distances) in [moments[moment][kind] for moment in range(least, most + 1)]


@pytest.mark.parametrize("keep", [True, False], ids=["kept", "dropped"])
@pytest.mark.parametrize("radii", [[100.0], [2.0, 1.0, 0.4, 0.2]], ids=["one leaf", "many leaves"])
def test_a_sample_is_seen_with_the_last_of_its_stores(radii: list[float], keep: bool) -> None:
    # What readers may meet between any two stores of a writer, one after the other.
    points = scattered(layout.FLAT_LANES + 60)
    tree = rpt.build(points[:30], radii=radii, keep_covered=keep)
    tree.reserve(len(points))
    tree.storage[30 : len(points)] = points[30:]

    def answers() -> list[list[float]]:
        k = min(3, tree.samples)
        parts = [*tree.exact(QUERIES[:2], k), *tree.beam(QUERIES[:2], k, 9), tree.at_level(QUERIES[:2], 2)]
        return [part.ravel().tolist() for part in parts]

    for number in range(30, len(points)):
        if JIT_OFF and number % 8 and number not in (layout.PAGE_LANES, layout.FLAT_LANES):
            tree.insert(points[number])
            continue
        before = answers()
        outcome, count = tree._prepare(number)
        if outcome == insert.NO_ROOM:
            tree.insert(points[number])
            continue
        assert answers() == before
        for i in range(count - 1):
            insert.publish(tree.arenas.integers, tree._stores[i : i + 1], 1)
            assert answers() == before
        insert.publish(tree.arenas.integers, tree._stores[count - 1 : count], 1)
        tree._size = number + 1
        tree._alive[number] = True
        tree._kept += outcome == insert.PREPARED
        if keep:
            assert tree.exact(points[number], 1).distances.tolist() == [0.0]
            assert tree.exact(QUERIES[0], 3).ids.tolist() == brute_force(points[: number + 1], QUERIES[0], 3)[0]


def test_many_writers_take_turns() -> None:
    points = scattered(300)
    tree = rpt.build(np.zeros((0, 2)), radii=[2.0, 0.5])

    def write(rows: Floats) -> list[int]:
        numbers = [int(tree.insert(row)[0]) for row in rows]
        tree.remove(numbers[::3])
        tree.repair()
        assert tree.statistics().invisible >= 0
        return numbers

    with ThreadPoolExecutor(3) as pool:
        given = [future.result(timeout=60) for future in [pool.submit(write, points[i::3]) for i in range(3)]]
    assert sorted(number for numbers in given for number in numbers) == list(range(300))
    living = {number for numbers in given for i, number in enumerate(numbers) if i % 3}
    for rows, numbers in zip((points[i::3] for i in range(3)), given, strict=True):
        assert np.array_equal(tree.points[numbers], rows)
    assert sorted(sample for leaf in tree.nodes().members for sample in leaf) == sorted(living)
    tree.repair()
    assert tree.exact(QUERIES[0], 9).ids.tolist() == brute_force(tree.points, QUERIES[0], 9, living)[0]


def test_a_search_that_began_when_the_tree_was_small_finds_room() -> None:
    # A batch of queries makes its stack once. Meanwhile a ring of nodes comes, at all of which a query must look: their
    # boxes are nearer than the second sample of its snapshot, though their vectors are farther than the first.
    points = np.full((600, 2), [1000.9, 0.0])
    points[0, 0] = 1000.0
    tree = rpt.build(points, radii=[1.0])
    stack = np.empty((tree.arenas.integers[layout.WAITING], 3))
    angles = np.linspace(0.1, 6.1, 1000)
    tree.insert(1000.5 * np.column_stack([np.cos(angles), np.sin(angles)]))
    assert tree.arenas.integers[layout.WAITING] > len(stack)
    ids, squares = np.empty(2, np.int64), np.empty(2)
    count = search.exact(np.zeros(2), *scan_nothing(tree).arenas, 600, ids, squares, stack, np.empty(LANES))
    assert (count, ids.tolist(), np.sqrt(squares).tolist()) == (2, [0, 1], [1000.0, 1000.9])


def test_a_search_for_all_samples_beside_a_removal_says_what_is_missing() -> None:
    # As a search meets it that was told there are three when the third was just being removed.
    tree = rpt.build([[0.0], [1.0], [2.0]])
    tree.remove(1)
    tree._kept = 3
    found = tree.exact([0.0], 3)
    assert found.ids.tolist() == [0, 2, -1]
    assert found.distances.tolist() == [0.0, 2.0, np.inf]
