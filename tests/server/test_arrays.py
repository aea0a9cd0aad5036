"""Files of arrays as they come over REST: damaged, malicious, or just of the wrong kind."""

from __future__ import annotations

import io
import struct
import zipfile
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from handeye.server.arrays import SAMPLES, floats, names, read_arrays
from handeye.server.problem import RequestError
from tests.server.rest import NPZ, done, packed, problem, samples, taught

if TYPE_CHECKING:
    from starlette.testclient import TestClient


def header(text: str, content: bytes = b"", version: tuple[int, int] = (1, 0)) -> bytes:
    """A .npy file with a header of one's own."""
    text = text + " " * (64 - (len(text) + 11) % 64) + "\n"
    length = struct.pack("<H" if version == (1, 0) else "<I", len(text))
    return b"\x93NUMPY" + bytes(version) + length + text.encode("latin-1") + content


def archive(compression: int = zipfile.ZIP_STORED, **entries: bytes) -> bytes:
    """A .zip file with entries of one's own."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as zipped:
        for name, content in entries.items():
            zipped.writestr(f"{name}.npy", content)
    return file.getvalue()


def npy(array: np.ndarray[Any, Any]) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


GOOD = npy(np.zeros((1, 2)))
BAD_ARRAYS = {
    "nothing": b"",
    "no zip": b"PK\x03\x04 and so on",
    "cut off": packed(inputs=np.zeros((9, 2)))[:-30],
    "text": archive(inputs=b"hello"),
    "objects": archive(
        inputs=header("{'descr': '|O', 'fortran_order': False, 'shape': (1, 2), }", b"\x80\x04]\x94(K\x01K\x02e.")
    ),
    "larger than it is": archive(
        inputs=header("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 2), }", b"12345678")
    ),
    "negative": archive(inputs=header("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 2), }", bytes(16))),
    "huge shape": archive(inputs=header("{'descr': '<f8', 'fortran_order': False, 'shape': (1" + "0" * 400 + ",), }")),
    "minus minus": archive(
        inputs=header("{'descr': '<f8', 'fortran_order': False, 'shape': (" + "-" * 5000 + "1,), }")
    ),
    "deep": archive(inputs=header("(" * 3000)),
    "no type": archive(inputs=header("{'descr': 'nothing', 'fortran_order': False, 'shape': (1, 2), }", bytes(16))),
    "odd type": archive(inputs=header("{'descr': [('a',)], 'fortran_order': False, 'shape': (1, 2), }", bytes(16))),
    "no size": archive(inputs=header("{'descr': '<U0', 'fortran_order': False, 'shape': (1000000000, 2), }")),
    "old version": archive(inputs=header("{'descr': '<f8', 'fortran_order': False, 'shape': (1, 2), }", b"", (9, 9))),
    "latin": archive(inputs=header("{'descr': '<f8', '\xe9': 1}")),
    "short": archive(inputs=GOOD[:-1]),
    "long": archive(inputs=GOOD + b"x"),
    "lzma": archive(zipfile.ZIP_LZMA, inputs=GOOD),
}


def test_files_that_are_no_arrays_are_malformed(http: TestClient, module: str) -> None:
    http.post(f"{module}/samples", json=samples(3))
    for name, body in BAD_ARRAYS.items():
        for path in (f"{module}/samples", f"{module}/query", "/v1/modules/import"):
            sentence = problem(http.post(path, content=body, headers=NPZ), 400, "malformed")
            assert "npz" in sentence, name
            assert len(sentence) < 500, name


@pytest.mark.parametrize(
    ("arrays", "wrong"),
    [
        ({"outputs": np.zeros((1, 2))}, "no array 'inputs'"),
        ({"inputs": np.zeros((1, 2))}, "no array 'outputs'"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "weights": np.zeros(1)}, "weights"),
        ({"inputs": np.array([["a", "b"]]), "outputs": np.zeros((1, 2))}, "real numbers"),
        ({"inputs": np.zeros((1, 2), complex), "outputs": np.zeros((1, 2))}, "real numbers"),
        ({"inputs": np.zeros((1, 2), "M8[s]"), "outputs": np.zeros((1, 2))}, "real numbers"),
        ({"inputs": np.zeros(1, [("x", "f8"), ("y", "f8")]), "outputs": np.zeros((1, 2))}, "real numbers"),
        ({"inputs": np.zeros(()), "outputs": np.zeros((1, 2))}, "(n, components)"),
        ({"inputs": np.zeros(2), "outputs": np.zeros((1, 2))}, "(n, components)"),
        ({"inputs": np.zeros((1, 1, 2)), "outputs": np.zeros((1, 2))}, "(n, components)"),
        ({"inputs": np.zeros((0, 2)), "outputs": np.zeros((0, 2))}, "(n, components)"),
        ({"inputs": np.zeros((1, 0)), "outputs": np.zeros((1, 2))}, "2 components"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((2, 2))}, "1 inputs, 2 outputs"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros(())}, "2 components"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.full((1, 2), "1e4000", "f16")}, "finite"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": np.zeros(1)}, "strings"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": ["a", "b"]}, "strings"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": np.array("a")}, "strings"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": ["a/b"]}, "called"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": ["a" * 9999]}, "called"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": ["a\nb"]}, "called"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": ["a\n"]}, "called"),
        ({"inputs": np.zeros((1, 2)), "outputs": np.zeros((1, 2)), "demonstrations": ["\ud800"]}, "called"),
    ],
)
def test_arrays_that_do_not_fit_are_told_apart(
    http: TestClient, module: str, arrays: dict[str, Any], wrong: str
) -> None:
    response = http.post(f"{module}/samples", content=packed(**arrays), headers=NPZ)
    assert wrong in problem(response, 422, "invalid_argument")
    assert len(response.json()["detail"]) < 500
    assert done(http.get(module))["samples"] == 0


def test_code_points_that_do_not_exist_are_refused(http: TestClient, module: str) -> None:
    text = "{'descr': '<U1', 'fortran_order': False, 'shape': (1,), }"
    for point in (0x110000, 0xFFFFFFFF):
        body = archive(inputs=GOOD, outputs=GOOD, demonstrations=header(text, struct.pack("<I", point)))
        problem(http.post(f"{module}/samples", content=body, headers=NPZ), 422, "invalid_argument")


def test_bombs_do_not_unpack(http: TestClient, module: str) -> None:
    bomb = archive(zipfile.ZIP_DEFLATED, inputs=npy(np.zeros((20_000_000, 2))))  # 320 MB
    assert len(bomb) < 1_000_000
    assert "bytes" in problem(http.post(f"{module}/query", content=bomb, headers=NPZ), 400, "malformed")


def test_compressed_arrays_are_read_and_broken_ones_refused(http: TestClient, module: str) -> None:
    inputs, outputs = taught(50)
    file = io.BytesIO()
    np.savez_compressed(file, inputs=inputs, outputs=outputs)
    assert done(http.post(f"{module}/samples", content=file.getvalue(), headers=NPZ), 201)["count"] == 50
    broken = bytearray(file.getvalue())
    start = broken.index(b"inputs.npy") + 60
    broken[start : start + 40] = bytes(40)
    problem(http.post(f"{module}/samples", content=bytes(broken), headers=NPZ), 400, "malformed")


def test_damaged_files_are_refused_wherever_they_are_damaged() -> None:
    random = np.random.default_rng(3)
    inputs, outputs = taught(3)
    file = io.BytesIO()
    np.savez_compressed(file, inputs=inputs, outputs=outputs, demonstrations=["a", "b", "c"])
    for sound in (file.getvalue(), packed(inputs=inputs, outputs=outputs, demonstrations=["a", "b", "c"])):
        for turn in range(1500):
            damaged = bytearray(sound)
            for place in random.integers(0, len(damaged), random.integers(1, 5)):
                damaged[place] = random.integers(0, 256)
            try:
                arrays = read_arrays(
                    bytes(damaged[: random.integers(1, len(damaged) + 1) if turn % 5 == 0 else None]), SAMPLES
                )
                floats(arrays, "inputs")
                names(arrays, 3)
            except RequestError:
                pass
