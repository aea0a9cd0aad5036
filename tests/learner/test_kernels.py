"""What only the kernels' own arrays show, and that they run without the compiler too."""

from __future__ import annotations

import os
import subprocess
import sys

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from handeye import rpt
from handeye.rpt import approximate, kernels

JIT_OFF = bool(numba.config.DISABLE_JIT)  # type: ignore[attr-defined]


@given(
    entries=st.lists(st.tuples(st.integers(0, 5).map(float), st.integers(0, 9)), max_size=30, unique_by=lambda e: e[1]),
    capacity=st.integers(1, 8),
)
@settings(deadline=None)
def test_insert_keeps_the_first_in_order(entries: list[tuple[float, int]], capacity: int) -> None:
    distances, keys, values = np.zeros(capacity), np.zeros(capacity, np.int64), np.zeros(capacity, np.int64)
    count = 0
    for distance, key in entries:
        count = kernels.insert(distances, keys, values, count, distance, key, 100 + key)
    expected = sorted(entries)[:capacity]
    assert count == len(expected)
    assert list(zip(distances[:count].tolist(), keys[:count].tolist(), strict=True)) == expected
    assert values[:count].tolist() == [100 + key for _, key in expected]


@given(seed=st.integers(0, 10**6), n=st.integers(1, 8), columns=st.integers(1, 3))
@settings(deadline=None)
def test_solve_in_place_solves(seed: int, n: int, columns: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n))
    matrix, right = root @ root.T + 0.1 * np.eye(n), rng.normal(size=(n, columns))
    solution = right.copy()
    kernels.solve_in_place(matrix.copy(), solution)
    assert np.allclose(matrix @ solution, right)


def test_kernels_release_the_interpreter_and_are_cached() -> None:
    if JIT_OFF:
        pytest.skip("the JIT is off")
    for name in ("grow", "arrange", "covering_radii", "beam_many", "exact_many", "local_fit"):
        options = getattr(kernels, name).targetoptions
        assert options["nogil"]
        assert options["nopython"]


def trace() -> str:
    """Everything that the kernels make of some random points."""
    points = np.random.default_rng(0).normal(size=(80, 3))
    tree = rpt.build(points)
    exact, beam = rpt.query_exact(tree, points + 0.1, 20), rpt.query_beam(tree, points + 0.1, 4)
    near = points[exact.ids[0]]
    weights = approximate.local_weights(exact.distances[0], smoothing=0.1)
    fit = approximate.local_quadratic(points[0] + 0.1, near, near**3, weights, ridge=1e-3, curvature_ridge=1e-2)
    return repr([tree.sample.tolist(), tree.cover.tolist(), exact.ids.tolist(), beam.ids.tolist(), fit.tolist()])


def test_compiled_and_plain_kernels_agree_to_the_last_bit() -> None:
    if JIT_OFF:
        pytest.skip("the JIT is off")
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    plain = subprocess.run([sys.executable, __file__], env=environment, capture_output=True, text=True, timeout=110)
    assert plain.returncode == 0, plain.stderr
    assert plain.stdout.strip() == trace()


if __name__ == "__main__":
    print(trace())
