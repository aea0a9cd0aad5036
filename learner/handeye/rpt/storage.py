"""The learner's file format: one file, checked by a sum, read without running anything.

    bytes       content
    8           signature: 89 52 50 54 0D 0A 1A 0A ("\\x89RPT\\r\\n\\x1a\\n"; a transfer as text would change it)
    4           version, little-endian; this is version 1
    8           length of the header, little-endian
    ...         header, JSON in UTF-8: {"kind": "model" or "mdf", "values": {}, "arrays": [{"name", "dtype", "shape"}]}
    ...         the arrays one after the other in that order, in rows, little-endian: <f8, <i8, |u1 or |b1
    32          SHA-256 of everything before

Of a `Model` the samples and settings are stored, not the tree: it is built anew, so that a file can never lead a search
outside its arrays. Answers of the exact search are the same to the last bit; a tree that had grown by insertion is the
tree that `repair` would have made. An `MDFTree` is stored as it is.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from handeye.rpt.mdf import MDFTree
from handeye.rpt.model import Model

Stored = TypeVar("Stored", Model, MDFTree)

SIGNATURE = b"\x89RPT\r\n\x1a\n"
VERSION = 1
DTYPES = ("<f8", "<i8", "|u1", "|b1")

_KINDS: dict[type, str] = {Model: "model", MDFTree: "mdf"}
_SUM = 32
_START = len(SIGNATURE) + 12


class StorageError(ValueError):
    """A file is not one of the learner's, is damaged, or was written by a newer version."""


def save(model: Model | MDFTree, path: str | os.PathLike[str]) -> None:
    """Writes a model with all its samples; an existing file is replaced at once or not at all.

    Raises:
        OSError: the file cannot be written; what was there before is still there.
    """
    target = Path(path)
    kind = _KINDS[type(model)]
    values, arrays = model.to_state()
    stored = {name: np.ascontiguousarray(array, _dtype(array)) for name, array in arrays.items()}
    described = [{"name": name, "dtype": a.dtype.str, "shape": list(a.shape)} for name, a in stored.items()]
    header = json.dumps({"kind": kind, "values": values, "arrays": described}).encode()
    parts: list[bytes | memoryview] = [
        SIGNATURE,
        VERSION.to_bytes(4, "little"),
        len(header).to_bytes(8, "little"),
        header,
    ]
    parts += [array.data.cast("B") for array in stored.values() if array.size]
    digest = hashlib.sha256()
    beside = target.with_name(f".{target.name}.{os.getpid()}")
    try:
        with beside.open("wb") as file:
            for part in parts:
                digest.update(part)
                file.write(part)
            file.write(digest.digest())
            file.flush()
            os.fsync(file.fileno())
        beside.replace(target)
    finally:
        beside.unlink(missing_ok=True)


def load(path: str | os.PathLike[str], kind: type[Stored] = Model) -> Stored:  # type: ignore[assignment]
    """Reads what `save` wrote: a `Model`, or an `MDFTree` with kind=MDFTree.

    Raises:
        StorageError: the file is foreign, damaged, of a newer version, or holds another kind; the sentence says which.
        OSError: the file cannot be read.
    """
    data = Path(path).read_bytes()
    if not data.startswith(SIGNATURE):
        raise StorageError(f"{path} is no file of handeye's learner: it begins with {data[:8]!r}")
    if len(data) < _START + _SUM:
        raise StorageError(f"{path} is damaged: it ends after {len(data)} bytes")
    version = int.from_bytes(data[len(SIGNATURE) : len(SIGNATURE) + 4], "little")
    if version != VERSION:
        raise StorageError(f"{path} has version {version}; this is handeye's learner of version {VERSION}: upgrade it")
    if hashlib.sha256(memoryview(data)[:-_SUM]).digest() != data[-_SUM:]:
        raise StorageError(f"{path} is damaged: its content does not fit its checksum; restore it from a backup")
    try:
        values, arrays = _parse(data, _KINDS[kind])
        return kind.from_state(values, arrays)
    except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
        raise StorageError(f"{path} does not hold what was asked for: {error}") from error


def _parse(data: bytes, kind: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """The values and arrays of a file whose sum is right."""
    end = _START + int.from_bytes(data[_START - 8 : _START], "little")
    header = json.loads(data[_START:end])
    if header["kind"] != kind:
        raise ValueError(f"it holds {header['kind']!r}, not {kind!r}")
    arrays = {}
    for described in header["arrays"]:
        dtype, shape = described["dtype"], [int(length) for length in described["shape"]]
        if dtype not in DTYPES or any(length < 0 for length in shape):
            raise ValueError(f"array {described['name']} has type {dtype} and shape {shape}")
        start, end = end, end + math.prod(shape) * np.dtype(dtype).itemsize
        if end > len(data) - _SUM:
            raise ValueError(f"array {described['name']} is longer than the file")
        arrays[str(described["name"])] = np.frombuffer(data[start:end], dtype).reshape(shape)
    if end != len(data) - _SUM:
        raise ValueError(f"{len(data) - _SUM - end} bytes belong to nothing")
    return cast(dict[str, Any], header["values"]), arrays


def _dtype(array: NDArray[Any]) -> str:
    return {"f": "<f8", "i": "<i8", "u": "|u1", "b": "|b1"}[array.dtype.kind]
