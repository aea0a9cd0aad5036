"""Samples and queries in files."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handeye.client import WrongArrays
from handeye.client._tables import read_queries, read_samples, write_table
from handeye.client.models import Component, Declaration, Output

DECLARATION = Declaration(
    name="m",
    inputs=(Component(name="x", unit="m"), Component(name="joint", unit="rad")),
    outputs=(Output(name="joint", unit="rad"),),
)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "samples.csv"


def test_columns_are_found_by_name(file: Path) -> None:
    file.write_text("demonstration,joint, x ,joint\ngrasp-1,1,2,3\n\n,4,5,6\n")
    samples = read_samples(file, DECLARATION, None)
    assert samples.inputs.tolist() == [[2.0, 1.0], [5.0, 4.0]]
    assert samples.outputs.tolist() == [[3.0], [6.0]]
    assert samples.demonstrations is not None
    assert samples.demonstrations.tolist() == ["grasp-1", ""]


def test_without_names_columns_are_in_the_declared_order(file: Path) -> None:
    file.write_text("\ufeff1,2,3\r\n4,5e-1,6\r\n")
    samples = read_samples(file, DECLARATION, "all of them")
    assert samples.inputs.tolist() == [[1.0, 2.0], [4.0, 0.5]]
    assert samples.demonstrations is not None
    assert samples.demonstrations.tolist() == ["all of them", "all of them"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no line of numbers"),
        ("x,joint,joint\n", "no line of numbers"),
        ("x,joint\n1,2\n", r"no column 'joint'; it needs: x, joint, joint"),
        ("x,joint,joint,more\n1,2,3,4\n", "a column 'more' too many"),
        ("x,joint,joint\n1,2,3\n1,2\n", "line 3 has 2 columns, not 3: x, joint, joint"),
        ("x,joint,joint\n1,2,three\n", "line 2: could not convert"),
        ("1,2\n", "line 1 has 2 columns, not 3"),
        ("1,2,nan\n", "outputs must be finite"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(file: Path, text: str, message: str) -> None:
    file.write_text(text)
    with pytest.raises(WrongArrays, match=message):
        read_samples(file, DECLARATION, None)


def test_arrays(tmp_path: Path) -> None:
    file = tmp_path / "samples.npz"
    np.savez(file, inputs=np.ones((2, 2)), outputs=np.zeros((2, 1)), demonstrations=np.array(["a", "b"]))
    samples = read_samples(file, DECLARATION, None)
    assert samples.demonstrations is not None
    assert samples.demonstrations.tolist() == ["a", "b"]
    assert read_queries(file, DECLARATION).shape == (2, 2)
    np.savez(file, inputs=np.ones((2, 2)))
    with pytest.raises(WrongArrays, match="no array 'outputs'; it has: inputs"):
        read_samples(file, DECLARATION, None)
    file.write_bytes(b"nonsense")
    with pytest.raises(WrongArrays, match=r"no \.npz file"):
        read_queries(file, DECLARATION)


@given(st.lists(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 2), min_size=1, max_size=5))
def test_numbers_are_written_and_read_to_the_last_bit(rows: list[tuple[float, float]]) -> None:
    text = write_table(("x", "joint"), rows)
    read = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1, ndmin=2)
    assert read.tobytes() == np.array(rows).tobytes()
