"""Samples, queries, answers and pictures as arrays: how they travel as .npz and .npy. Nothing is ever pickled."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike, NDArray

from handeye.client.errors import WrongArrays

NPZ = "application/x-npz"
NPY = "application/x-npy"

BATCH_ROWS = 10_000
"""The coordinator takes so many samples or queries at once."""
BATCH_BYTES = 4 * 2**20
"""A batch of long vectors has fewer rows, so that no request grows large."""

Floats = NDArray[np.float64]


class Image(NamedTuple):
    """A picture: `pixels` (rows, columns, 3) uint8, red green blue, and the world time in s that it shows."""

    pixels: NDArray[np.uint8]
    world_time: float


class Samples(NamedTuple):
    """n samples: `inputs` (n, N), `outputs` (n, M), and the demonstration of each, "" for none; or None for all."""

    inputs: Floats
    outputs: Floats
    demonstrations: NDArray[np.str_] | None


@dataclass(frozen=True, eq=False, slots=True)
class QueryAnswers:
    """What a module says to q queries; k neighbours each, nearest first.

    Where there were fewer neighbours, the rest has sample -1, demonstration "", an infinite distance and no weight.
    """

    outputs: Floats
    """(q, M) in the outputs' units."""
    support: Floats
    """(q,) in [0, 1]: how well inside the taught region the query lies."""
    expected_error: Floats
    """(q, M) what the error of each output should not exceed in nine of ten cases; infinite while unknown."""
    samples: NDArray[np.int64]
    """(q, k) numbers of the samples that the answer was made from."""
    distances: Floats
    """(q, k) from the query, after each component was divided by its scale."""
    weights: Floats
    """(q, k) shares in the answer."""
    demonstrations: NDArray[np.str_]
    """(q, k) ids of the demonstrations that the samples came from; "" for none."""

    def __len__(self) -> int:
        return len(self.outputs)


def samples(inputs: ArrayLike, outputs: ArrayLike, demonstrations: str | Sequence[str] | None) -> Samples:
    """What was given as samples, checked; `WrongArrays` says what does not fit. One name stands for all samples."""
    rows, values = matrix(inputs, "inputs"), matrix(outputs, "outputs")
    names: NDArray[np.str_] | None = None
    if demonstrations is not None:
        given = [demonstrations] * len(rows) if isinstance(demonstrations, str) else list(demonstrations)
        names = np.array(given, dtype=np.str_)
    if len(rows) != len(values) or (names is not None and names.shape != (len(rows),)):
        named = "" if names is None else f" and {len(names)} demonstrations"
        raise WrongArrays(f"{len(rows)} inputs, {len(values)} outputs{named}: each sample needs one of each")
    return Samples(rows, values, names)


def matrix(values: ArrayLike, what: str) -> Floats:
    """`values` as float64 (n, components); `WrongArrays` unless it has two axes, a row, and finite numbers only."""
    try:
        array = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise WrongArrays(f"{what} must be numbers, one row each: {error}") from error
    if array.ndim != 2 or not len(array):
        raise WrongArrays(f"{what} must have shape (n, components) with n of at least 1, not {array.shape}")
    if not np.isfinite(array).all():
        row = int(np.argmin(np.isfinite(array).all(axis=1)))
        raise WrongArrays(f"{what} must be finite, row {row} is {array[row].tolist()}")
    return array


def vector(values: ArrayLike, what: str) -> list[float]:
    """`values` as a list of finite numbers; `WrongArrays` when they are something else."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise WrongArrays(f"{what} must be numbers: {error}") from error
    if array.ndim != 1 or not np.isfinite(array).all():
        raise WrongArrays(f"{what} must be a row of finite numbers, not {array.tolist()}")
    return [float(value) for value in array]


def rows_of_points(values: ArrayLike) -> list[list[list[float]]]:
    """`values` (rows, columns, 3) as lists; `WrongArrays` when they are something else or not finite."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise WrongArrays(f"points must be numbers: {error}") from error
    if array.ndim != 3 or array.shape[2] != 3 or not np.isfinite(array).all():
        raise WrongArrays(f"points must be finite, of shape (rows, columns, 3), not {array.shape}")
    rows: list[list[list[float]]] = array.tolist()
    return rows


def batches(rows: Floats, other: Floats | None = None) -> Iterator[slice]:
    """Parts of `rows` (and as many rows of `other`) that are sent at once."""
    width = 8 * (rows.shape[1] + (0 if other is None else other.shape[1]))
    step = max(1, min(BATCH_ROWS, BATCH_BYTES // width))
    for start in range(0, len(rows), step):
        yield slice(start, start + step)


def encode(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """An .npz file of `arrays`."""
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **dict(arrays))
    return file.getvalue()


def encode_samples(given: Samples, part: slice) -> bytes:
    """Some of the samples as the .npz that POST /v1/modules/{module}/samples takes."""
    arrays: dict[str, NDArray[Any]] = {"inputs": given.inputs[part], "outputs": given.outputs[part]}
    if given.demonstrations is not None:
        arrays["demonstrations"] = given.demonstrations[part]
    return encode(arrays)


def decode(content: bytes) -> dict[str, NDArray[Any]]:
    """The arrays of an .npz file; `ValueError` when it is none, or damaged."""
    if content[:2] != b"PK":
        raise ValueError("this is no .npz file")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    # zipfile takes damage for encryption, for a compression that it does not know, for sizes that cannot be.
    except (BadZipFile, EOFError, MemoryError, OverflowError, RuntimeError, struct.error, zlib.error) as error:
        raise ValueError(f"this .npz file is damaged: {error}") from error


def decode_answers(content: bytes) -> QueryAnswers:
    """The .npz that answers queries; `ValueError` or `LookupError` when it is something else."""
    arrays = decode(content)
    # The last name stands for "none": that is where index -1 leads.
    names = np.append(arrays["names"].astype(np.str_), "")
    found = arrays["demonstrations"].astype(np.int64)
    if ((found < -1) | (found >= len(arrays["names"]))).any():
        raise IndexError("a sample is from a demonstration without a name")
    answers = QueryAnswers(
        outputs=arrays["outputs"].astype(np.float64),
        support=arrays["support"].astype(np.float64),
        expected_error=arrays["expected_error"].astype(np.float64),
        samples=arrays["samples"].astype(np.int64),
        distances=arrays["distances"].astype(np.float64),
        weights=arrays["weights"].astype(np.float64),
        demonstrations=names[found],
    )
    count, components = answers.outputs.shape
    nearest = (count, answers.samples.shape[-1])
    wanted = {"support": (count,), "expected_error": (count, components)}
    for field in fields(answers)[1:]:
        shape = getattr(answers, field.name).shape
        if shape != wanted.get(field.name, nearest):
            raise ValueError(f"{field.name} has shape {shape}, not {wanted.get(field.name, nearest)}")
    return answers


_EMPTY: dict[str, Any] = {"samples": -1, "distances": np.inf, "weights": 0.0, "demonstrations": ""}


def join(parts: Sequence[QueryAnswers]) -> QueryAnswers:
    """Answers to parts of the queries as one; those with fewer neighbours are filled up."""
    most = max(part.samples.shape[1] for part in parts)

    def joined(name: str) -> Any:
        arrays = [getattr(part, name) for part in parts]
        if name in _EMPTY:
            arrays = [
                np.pad(array, ((0, 0), (0, most - array.shape[1])), constant_values=_EMPTY[name])
                if array.shape[1] < most
                else array
                for array in arrays
            ]
        return np.concatenate(arrays)

    return parts[0] if len(parts) == 1 else QueryAnswers(**{each.name: joined(each.name) for each in fields(parts[0])})


def decode_image(content: bytes) -> NDArray[np.uint8]:
    """A picture from an .npy file; `ValueError` when it is none."""
    pixels = np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3:
        raise ValueError(f"a picture is uint8 of shape (rows, columns, 3), not {pixels.dtype} of {pixels.shape}")
    return np.asarray(pixels, dtype=np.uint8)
