"""What only the kernels' own arrays show, and that they run without the compiler too."""

from __future__ import annotations

import hashlib
import importlib
import math
import os
import pkgutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from handeye import rpt
from handeye.rpt import approximate, kernels
from handeye.rpt.kernels import construct, fit, lanes, layout, search
from tests.learner.forms import JIT_OFF, Floats, examples

MODULES = [
    importlib.import_module(f"{kernels.__name__}.{module.name}") for module in pkgutil.iter_modules(kernels.__path__)
]


# --- single kernels ---------------------------------------------------------------------------------------------------


@numba.njit  # type: ignore[untyped-decorator]
def eight(block: Floats, query: Floats, worst: float, out: Floats, boxes: bool) -> int:
    """The intrinsics can be called from compiled functions only."""
    if boxes:
        return lanes.box_squares(block, 8, query, worst, out)  # type: ignore[no-any-return, no-untyped-call]
    return lanes.point_squares(block, 8, query, worst, out)  # type: ignore[no-any-return, no-untyped-call]


@numba.njit  # type: ignore[untyped-decorator]
def lowest_bit(mask: int) -> int:
    return lanes.lowest_bit(mask)  # type: ignore[no-any-return, no-untyped-call]


@given(seed=st.integers(0, 10**6), d=st.integers(1, 9), boxes=st.booleans(), empty=st.integers(0, 8))
@examples(100)
def test_eight_squared_distances_at_once(seed: int, d: int, boxes: bool, empty: int) -> None:
    rng = np.random.default_rng(seed)
    query = rng.normal(size=d)
    lower = rng.normal(size=(8, d))
    lower[8 - empty :] = np.inf
    upper = lower + rng.exponential(size=(8, d)) * rng.integers(0, 2, size=(8, 1))
    expected = []
    for low, high in zip(lower.tolist(), upper.tolist(), strict=True):
        total = 0.0
        for a, b, x in zip(low, high, query.tolist(), strict=True):
            step = max(a - x, x - b, 0.0) if boxes else a - x
            total += step * step
        expected.append(total)
    # The chunk stands behind eight other numbers.
    block = np.concatenate([np.full(8, np.nan), lower.T.ravel(), upper.T.ravel()])
    worst = sorted(expected)[int(rng.integers(8))]
    out = np.empty(8)
    mask = eight(block, query, worst, out, boxes)
    assert out.tolist() == expected
    assert [bool(mask >> lane & 1) for lane in range(8)] == [square <= worst for square in expected]
    assert mask < 256


@given(mask=st.integers(1, 255))
@examples(50)
def test_lowest_bit(mask: int) -> None:
    expected = f"{mask:b}"[::-1].index("1")
    assert lowest_bit(mask) == expected
    # Masks become numpy's numbers on the way.
    assert lowest_bit(np.int64(mask)) == expected


@given(
    offered=st.lists(
        st.tuples(st.integers(0, 5).map(float), st.integers(0, 99)), max_size=30, unique_by=lambda e: e[1]
    ),
    k=st.integers(1, 8),
)
@examples(100)
def test_offer_keeps_the_nearest_in_order(offered: list[tuple[float, int]], k: int) -> None:
    ids, squares = np.full(k, -1), np.full(k, np.inf)
    count = 0
    for square, sample in offered:
        count = search.offer(ids, squares, count, square, sample)
    expected = sorted(offered)[:k]
    assert count == len(expected)
    assert list(zip(squares[:count].tolist(), ids[:count].tolist(), strict=True)) == expected


@given(keys=st.lists(st.integers(0, 9).map(float), min_size=1, max_size=60), place=st.integers(0, 60))
@examples(100)
def test_select_parts_small_keys_from_large(keys: list[float], place: int) -> None:
    middle = min(place, len(keys) - 1)
    order = np.arange(len(keys))
    construct.select(np.array(keys), order, 0, len(keys), middle)
    found = [keys[i] for i in order]
    assert sorted(order.tolist()) == list(range(len(keys)))
    assert max(found[:middle], default=-1.0) <= min(found[middle:])
    assert found[middle] == sorted(keys)[middle]


@given(seed=st.integers(0, 10**6), n=st.integers(1, 8), columns=st.integers(1, 3))
@examples(100)
def test_solve_in_place_solves(seed: int, n: int, columns: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n))
    matrix, right = root @ root.T + 0.1 * np.eye(n), rng.normal(size=(n, columns))
    solution = right.copy()
    smallest = fit.solve_in_place(matrix.copy(), solution)
    assert np.allclose(matrix @ solution, right)
    assert smallest == pytest.approx(float(np.min(np.diag(np.linalg.cholesky(matrix)) ** 2)))


# --- the arenas -------------------------------------------------------------------------------------------------------


def families(tree: rpt.Tree) -> Iterator[tuple[int, list[int]]]:
    """Each family that the root leads to, and the samples below it; an entry of a page may be a removed one."""
    integers = tree.arenas.integers

    def below(family: int) -> list[int]:
        entries: list[int] = integers[family + layout.ENTRIES :][: integers[family + layout.COUNT]].tolist()
        if integers[family + layout.KIND] == layout.PAGE:
            return entries
        return [sample for entry in entries for sample in below(entry)]

    waiting = [int(integers[layout.ROOT])]
    while waiting:
        family = waiting.pop()
        yield family, below(family)
        if integers[family + layout.KIND] != layout.PAGE:
            waiting += integers[family + layout.ENTRIES :][: integers[family + layout.COUNT]].tolist()


def check_arenas(tree: rpt.Tree, *, tight: bool) -> None:
    """Boxes hold what lies below (and no more, if tight); unused lanes are far away; the header tells the truth."""
    integers, floats = tree.arenas
    d = tree.points.shape[1]
    samples = dict(families(tree))
    for family in samples:
        kind, _, block, capacity, count = integers[family : family + layout.ENTRIES].tolist()
        rows = {layout.PAGE: 1, layout.GROUPS: 2, layout.NODES: 3}[kind]
        most = {layout.PAGE: layout.PAGE_LANES, layout.GROUPS: layout.GROUP_LANES, layout.NODES: capacity}[kind]
        assert count <= capacity <= most or (count, capacity) == (0, lanes.LANES)
        assert capacity <= integers[layout.WIDEST]
        chunks = floats[block : block + rows * capacity * d].reshape(-1, rows, d, lanes.LANES)
        content = chunks.transpose(0, 3, 1, 2).reshape(-1, rows, d)
        # Beyond a few copied lanes, unused ones are infinitely far away.
        assert np.all(np.isinf(content[layout.whole_chunks(count) :]))
        entries = integers[family + layout.ENTRIES :][:count].tolist()
        if kind == layout.PAGE:
            alive = [lane for lane, entry in enumerate(entries) if entry >= 0]
            assert np.array_equal(content[alive, 0], tree.points[[entries[lane] for lane in alive]])
            assert [tree.slots[entries[lane]] for lane in alive] == [family + layout.ENTRIES + lane for lane in alive]
            continue
        if kind == layout.NODES:
            vectors = integers[family + layout.ENTRIES + capacity :][:count]
            assert np.array_equal(content[:count, 2], tree.points[vectors])
        for lane, entry in enumerate(entries):
            points = tree.points[[sample for sample in samples[entry] if sample >= 0]]
            if not len(points):
                continue
            lower, upper = content[lane, :2]
            assert np.all(lower <= points.min(axis=0))
            assert np.all(upper >= points.max(axis=0))
            if tight:
                assert np.array_equal(lower, points.min(axis=0))
                assert np.array_equal(upper, points.max(axis=0))
    alive_samples = sorted(sample for sample in samples[int(integers[layout.ROOT])] if sample >= 0)
    assert len(alive_samples) == tree.samples == len(set(alive_samples))
    assert integers[layout.SAMPLES] == len(tree.points)
    assert integers[layout.INTEGERS_END] <= len(integers)
    assert integers[layout.FLOATS_END] <= len(floats)


@pytest.mark.parametrize("n", [0, 1, 8, 9, 64, 65, 129, 700] + [2500] * (not JIT_OFF))
@pytest.mark.parametrize("radii", [[100.0], [1.0, 0.3]], ids=["one leaf", "many leaves"])
@pytest.mark.parametrize("d", [1, 3])
def test_arenas_are_in_order(n: int, radii: list[float], d: int) -> None:
    rng = np.random.default_rng(n)
    points = rng.normal(size=(n, d))
    tree = rpt.build(points, radii=radii)
    check_arenas(tree, tight=True)
    tree.insert(rng.normal(size=(n // 2 + 20, d)))
    check_arenas(tree, tight=False)
    tree.remove(rng.choice(len(tree.points), size=len(tree.points) // 3, replace=False))
    tree.insert(rng.normal(size=(n // 2, d)))
    check_arenas(tree, tight=False)
    tree.repair()
    check_arenas(tree, tight=True)


@pytest.mark.parametrize("n", [1, 100, layout.FLAT_LANES])
def test_few_samples_stand_on_a_page_of_their_own(n: int) -> None:
    points = np.random.default_rng(n).normal(size=(n, 2))
    # Radii are given: derived ones would be derived anew on the way, and the tree built again.
    tree = rpt.build(points, radii=[1.0])
    integers = tree.arenas.integers
    flat = integers[layout.FLAT]
    assert integers[flat + layout.ENTRIES :][: integers[flat + layout.COUNT]].tolist() == list(range(n))
    assert not rpt.build(points, keep_covered=False).arenas.integers[layout.FLAT]
    tree.remove(0)
    tree.insert(np.zeros((layout.FLAT_LANES - n, 2)))
    assert tree.arenas.integers[layout.FLAT]
    tree.insert([0.0, 0.0])
    assert not tree.arenas.integers[layout.FLAT]
    tree.repair()
    assert tree.arenas.integers[layout.FLAT]


# --- with and without the compiler ------------------------------------------------------------------------------------


def test_kernels_release_the_interpreter_and_are_cached() -> None:
    if JIT_OFF:
        pytest.skip("the JIT is off")
    dispatchers = {
        name: value
        for module in MODULES
        for name, value in vars(module).items()
        if isinstance(value, numba.core.dispatcher.Dispatcher)
    }
    assert {"construct", "prepare", "publish", "exact_many", "beam_many", "local_fit"} <= dispatchers.keys()
    for name, dispatcher in dispatchers.items():
        assert dispatcher.targetoptions["nogil"], name
        assert dispatcher.targetoptions["nopython"], name
        assert type(dispatcher._cache).__name__ != "NullCache", name


def written(tree: rpt.Tree) -> Iterator[NDArray[Any]]:
    """All that has been written to the arenas; entries that no count covers hold whatever was there before."""
    integers, floats = tree.arenas
    yield integers[: layout.HEADER]
    for family, _ in families(tree):
        capacity, count = integers[family + layout.CAPACITY], integers[family + layout.COUNT]
        yield integers[family : family + layout.ENTRIES + count]
        if integers[family + layout.KIND] == layout.NODES:
            yield integers[family + layout.ENTRIES + capacity :][:count]
    yield floats[: integers[layout.FLOATS_END]]


def trace() -> dict[str, str]:
    """Digests of everything that the kernels make of some samples."""
    made: dict[str, Any] = {}
    rng = np.random.default_rng(0)
    sets = {
        "scattered": rng.normal(size=(700, 3)),
        "ties": rng.integers(-4, 5, size=(300, 2)) / 3,
        "small numbers": rng.normal(size=(150, 4)) * 1e-160,
    }
    for name, points in sets.items():
        made[f"{name}: radii"] = rpt.derive_radii(points), rpt.derive_radii(points, fan_out=3)
        size = math.sqrt(points.var())
        tree = rpt.build(points[: len(points) // 2], radii=[size, size / 2, size / 4])

        def note(step: str, tree: rpt.Tree = tree, points: Floats = points, name: str = name) -> None:
            made[f"{name}, {step}: arenas"] = written(tree)
            figures = tree.statistics()
            made[f"{name}, {step}: figures"] = (np.array(figures[:6] + figures[7:], np.float64),)
            queries = points[::9] * 1.01
            made[f"{name}, {step}: exact"] = tree.exact(queries, 20)
            made[f"{name}, {step}: beam"] = (*tree.beam(queries, 4, 6), tree.nodes_looked_at(queries, 6))
            made[f"{name}, {step}: levels"] = [tree.at_level(queries, level) for level in (1, 2, 3)]

        note("built")
        tree.insert(points[len(points) // 2 :])
        note("inserted")
        tree.remove(np.arange(0, len(points), 4))
        note("removed")
        tree.repair()
        note("repaired")
    points = sets["scattered"][:60]
    near, values = points[:20], np.column_stack([points[:20] ** 3, points[:20, :1]])
    weights = approximate.local_weights(np.linspace(0.1, 1, 20), smoothing=0.1)
    made["fits"] = [
        approximate.local_linear(points[0] + 0.1, near, values, weights, ridge=1e-3),
        approximate.local_quadratic(points[0] + 0.1, near, values, weights, ridge=1e-3, curvature_ridge=1e-2),
        approximate.leaf_map(near[0], values[0], near, values),
        approximate.estimate_gradients(rpt.build(near), values, neighbours=9, smoothing=0.1, ridge=1e-6),
    ]
    return {
        name: hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()
        for name, parts in made.items()
    }


def test_compiled_and_plain_kernels_agree_to_the_last_bit() -> None:
    if JIT_OFF:
        pytest.skip("the JIT is off")
    plain = subprocess.run(
        [sys.executable, "-m", "tests.learner.test_kernels"],
        cwd=Path(__file__).parents[2],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        timeout=110,
    )
    assert plain.returncode == 0, plain.stderr
    compiled = trace()
    assert len(compiled) > 40
    assert dict(line.split("\t") for line in plain.stdout.splitlines()) == compiled


if __name__ == "__main__":
    for what, digest in trace().items():
        print(what, digest, sep="\t")
