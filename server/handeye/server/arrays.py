"""Arrays as files that `numpy.load` reads: .npz for samples, queries, answers and whole modules, .npy for pictures."""

from __future__ import annotations

import io
import math
import re
import zipfile
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray
from pydantic import ValidationError

from handeye.modules.answers import Answers, TaughtSamples
from handeye.modules.declaration import ModuleDeclaration
from handeye.server.problem import Invalid, Malformed, RequestError
from handeye.server.schemas.base import LONG_NAME
from handeye.server.schemas.modules import NewModule
from handeye.server.store.modules import StoredModule

MEDIA_TYPE = "application/x-npz"
NPY_MEDIA_TYPE = "application/x-npy"

_MOST_BYTES = 64 * 2**20
"""That the arrays of a file may have once they are unpacked."""
MOST_BYTES_OF_MODULE = 2**30
"""The same for a whole module."""

SAMPLES = frozenset({"inputs", "outputs", "demonstrations"})
QUERIES = frozenset({"inputs", "neighbours"})
_MODULE = SAMPLES | {"declaration", "numbers"}

_HEADERS = {(1, 0): npy_format.read_array_header_1_0, (2, 0): npy_format.read_array_header_2_0}
_PACKED = frozenset({zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED})  # how numpy packs
_SHOWN = 80  # characters of a name that a sentence repeats

Arrays = Mapping[str, NDArray[Any]]


def npz(**arrays: NDArray[Any]) -> bytes:
    """The arrays as one .npz file, not compressed: packing takes longer than sending."""
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **arrays)
    return file.getvalue()


def npy(array: NDArray[Any]) -> bytes:
    """The array as a .npy file."""
    file = io.BytesIO()
    np.save(file, array, allow_pickle=False)
    return file.getvalue()


def read_arrays(content: bytes, known: Collection[str], most: int = _MOST_BYTES) -> dict[str, NDArray[Any]]:
    """The arrays of a .npz file by name; they may have `most` bytes.

    `Malformed` when it is none, or holds objects; `Invalid` when an array is none of `known`.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return _unpacked(archive, known, most)
    except RequestError:
        raise
    except Exception as error:  # zipfile, zlib and numpy have one of every kind for files that are none
        why = str(error)[:_SHOWN] or "it is damaged"
        raise Malformed(f"The body is no .npz file of plain arrays: {why}.") from error


def _unpacked(archive: zipfile.ZipFile, known: Collection[str], most: int) -> dict[str, NDArray[Any]]:
    entries = archive.infolist()
    unpacked = sum(entry.file_size for entry in entries)
    if unpacked > most:
        raise Malformed(f"The arrays of the .npz file would take {unpacked} bytes; {most} are allowed.")
    arrays = {}
    for entry in entries:
        if (name := entry.filename.removesuffix(".npy")) not in known:
            raise Invalid(f"The file has an array {name[:_SHOWN]!r}; known are: {', '.join(sorted(known))}.")
        if entry.compress_type not in _PACKED:
            raise ValueError("its arrays are packed otherwise than by numpy")
        arrays[name] = _array(archive.read(entry))
    return arrays


def _array(content: bytes) -> NDArray[Any]:
    """The array of a .npy file. Not `numpy.load`: that takes as much memory as the header says before it reads on."""
    file = io.BytesIO(content)
    shape, in_columns, dtype = _HEADERS[npy_format.read_magic(file)](file)
    values = content[file.tell() :]
    if dtype.hasobject or not dtype.itemsize:
        raise ValueError(f"arrays of type {dtype} are not read")
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != len(values):
        raise ValueError("an array has another size than its shape says")
    return np.ndarray(shape, dtype, values, order="F" if in_columns else "C")


def floats(arrays: Arrays, name: str) -> NDArray[np.float64]:
    """One array of numbers; `Invalid` when it is not there or holds something else."""
    if name not in arrays:
        raise Invalid(f"The file has no array '{name}'; it has: {', '.join(sorted(arrays)) or 'none'}.")
    array = arrays[name]
    if array.dtype.kind not in "fiub":
        raise Invalid(f"Array '{name}' must hold real numbers, not {str(array.dtype)[:_SHOWN]}.")
    with np.errstate(over="ignore"):  # what is too large becomes infinite, which is refused later
        return array.astype(np.float64)


def names(arrays: Arrays, count: int) -> list[str | None]:
    """The array `demonstrations`: a name for each of `count` samples, "" for none; all None when it is not there."""
    if "demonstrations" not in arrays:
        return [None] * count
    array = arrays["demonstrations"]
    if array.dtype.kind != "U" or array.shape != (count,):
        raise Invalid(
            f"Array 'demonstrations' must hold {count} strings, not {str(array.dtype)[:_SHOWN]} of shape {array.shape}."
        )
    found = _texts(array, "demonstrations")
    for name in {*found} - {""}:
        if not re.fullmatch(LONG_NAME, name):
            raise Invalid(f"A demonstration cannot be called {name[:_SHOWN]!r}; a name looks like 'grasp-1'.")
    return [name or None for name in found]


def _texts(array: NDArray[Any], name: str) -> list[str]:
    """The strings of an array of kind U, whatever its shape; `Invalid` when a character does not exist."""
    if np.frombuffer(array.astype(array.dtype.newbyteorder("=")).tobytes(), np.uint32).max(initial=0) > 0x10FFFF:
        raise Invalid(f"Array '{name}' has characters that do not exist.")
    return [str(text) for text in array.reshape(-1).tolist()]


def answers_file(answers: Answers) -> bytes:
    """Answers as a .npz file; its arrays are named and shaped as those of `Answers`."""
    return npz(
        outputs=answers.outputs,
        support=answers.support,
        expected_error=answers.expected_error,
        samples=answers.samples,
        demonstrations=answers.demonstrations,
        distances=answers.distances,
        weights=answers.weights,
        names=np.array(answers.names, dtype=np.str_),
    )


def exported(module: StoredModule, pieces: Sequence[TaughtSamples]) -> bytes:
    """A module with its samples as one file."""
    width, height = len(module.declaration.inputs), len(module.declaration.outputs)
    return npz(
        declaration=np.array(module.declaration.model_dump_json()),
        numbers=np.concatenate([np.zeros(0, np.int64), *(piece.numbers for piece in pieces)]),
        inputs=np.concatenate([np.zeros((0, width)), *(piece.inputs for piece in pieces)]),
        outputs=np.concatenate([np.zeros((0, height)), *(piece.outputs for piece in pieces)]),
        demonstrations=np.array([name or "" for piece in pieces for name in piece.demonstrations], dtype=np.str_),
    )


def imported(content: bytes) -> tuple[ModuleDeclaration, TaughtSamples]:
    """What `exported` gave. `Malformed` or `Invalid` when it did not give it."""
    arrays = read_arrays(content, _MODULE, MOST_BYTES_OF_MODULE)
    declared = arrays.get("declaration")
    if declared is None or declared.dtype.kind != "U" or declared.shape != ():
        raise Invalid("The file has no string 'declaration': it is none that GET /v1/modules/{module}/export gave.")
    (text,) = _texts(declared, "declaration")
    try:
        declaration = NewModule.model_validate_json(text.encode(errors="surrogatepass"))
    except ValidationError as error:
        wrong = error.errors()[0]
        place = ".".join(map(str, wrong["loc"]))[:_SHOWN]
        raise Invalid(f"The file's declaration is not as expected: {place}: {wrong['msg']}.") from error
    inputs, outputs = floats(arrays, "inputs"), floats(arrays, "outputs")
    count = len(inputs) if inputs.ndim else 0
    return declaration, TaughtSamples(np.arange(count), inputs, outputs, names(arrays, count))
