"""Samples and queries in files: .csv with a column for each component, or .npz with arrays."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from handeye.client._arrays import Floats, Samples, decode, samples
from handeye.client.errors import WrongArrays
from handeye.client.models import Component, Declaration, Output

LABEL = "demonstration"
"""The column that says which demonstration a sample is from."""


def read_samples(path: Path, declaration: Declaration, demonstration: str | None) -> Samples:
    """The samples in a file; all of them get `demonstration` as their label if it is given.

    A .csv has the inputs and outputs by name in its first line, in any order, and may have a column "demonstration";
    without that line they are in the declared order. An .npz has arrays inputs, outputs and perhaps demonstrations.
    """
    if path.suffix == ".npz":
        arrays = _arrays(path, ("inputs", "outputs"))
        named = arrays.get("demonstrations")
        labels = None if named is None else [str(name) for name in named]
        return samples(arrays["inputs"], arrays["outputs"], demonstration or labels)
    names = _names(declaration.inputs)
    values, labels = _table(path, (*names, *_names(declaration.outputs)))
    return samples(values[:, : len(names)], values[:, len(names) :], demonstration or labels)


def read_queries(path: Path, declaration: Declaration) -> Floats:
    """The queries in a file, (q, N): a .csv of the inputs, or an .npz with the array inputs."""
    if path.suffix == ".npz":
        return np.asarray(_arrays(path, ("inputs",))["inputs"], dtype=np.float64)
    return _table(path, _names(declaration.inputs))[0]


def write_table(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """CSV with a first line of names."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue()


def _names(components: Sequence[Component | Output]) -> tuple[str, ...]:
    return tuple(component.name for component in components)


def _arrays(path: Path, needed: Sequence[str]) -> dict[str, NDArray[Any]]:
    try:
        arrays = decode(path.read_bytes())
    except ValueError as error:
        raise WrongArrays(f"{path} is no .npz file of numbers and texts: {error}") from error
    if missing := [name for name in needed if name not in arrays]:
        raise WrongArrays(f"{path} has no array {missing[0]!r}; it has: {', '.join(arrays) or 'none'}")
    return arrays


def _table(path: Path, wanted: tuple[str, ...]) -> tuple[Floats, list[str] | None]:
    """The columns `wanted`, (n, columns) in that order, and the labels if there are any."""
    with path.open(newline="", encoding="utf-8-sig") as file:
        lines = [(number, line) for number, line in enumerate(csv.reader(file), start=1) if line]
    if lines and not _numbers(lines[0][1]):
        columns, label = _columns(path, [name.strip() for name in lines.pop(0)[1]], wanted)
    else:
        columns, label = list(range(len(wanted))), None
    if not lines:
        raise WrongArrays(f"{path} has no line of numbers")
    width = max(len(wanted), *(column + 1 for column in columns)) if label is None else max(*columns, label) + 1
    values = np.empty((len(lines), len(wanted)))
    for row, (number, line) in enumerate(lines):
        if len(line) != width:
            raise WrongArrays(f"{path}, line {number} has {len(line)} columns, not {width}: {', '.join(wanted)}")
        try:
            values[row] = [float(line[column]) for column in columns]
        except ValueError as error:
            raise WrongArrays(f"{path}, line {number}: {error}") from error
    return values, None if label is None else [line[label].strip() for _number, line in lines]


def _columns(path: Path, header: list[str], wanted: Sequence[str]) -> tuple[list[int], int | None]:
    """Where each wanted column is, and where the label is. Of two columns with one name the first is the input."""
    left = list(enumerate(header))
    columns = []
    for name in wanted:
        found = next((each for each in left if each[1] == name), None)
        if found is None:
            raise WrongArrays(f"{path} has no column {name!r}; it needs: {', '.join(wanted)}")
        left.remove(found)
        columns.append(found[0])
    label = next((each for each in left if each[1] == LABEL), None)
    if label is not None:
        left.remove(label)
    if left:
        raise WrongArrays(f"{path} has a column {left[0][1]!r} too many; it needs: {', '.join(wanted)}")
    return columns, None if label is None else label[0]


def _numbers(line: Sequence[str]) -> bool:
    try:
        [float(value) for value in line]
    except ValueError:
        return False
    return True
