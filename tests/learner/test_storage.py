"""The file format: what is written is read again; what is damaged is said so."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from handeye.rpt import Model, Settings, storage
from handeye.rpt.settings import METHODS


def taught(method: Any = "kndb2") -> Model:
    model = Model(3, 2, Settings(method), scales=[1.0, 10.0, 0.1], categorical=[0])
    rng = np.random.default_rng(1)
    inputs = rng.normal(size=(60, 3)) * [0, 10, 0.1] + [[1.0 * (i % 2), 0, 0] for i in range(60)]
    model.learn(inputs, rng.normal(size=(60, 2)), groups=np.arange(60) // 6)
    model.forget([4, 5, 40])
    return model


QUERIES = np.column_stack([np.tile([0.0, 1.0], 10), np.linspace(-9, 9, 20), np.linspace(0.1, -0.1, 20)])


@pytest.mark.parametrize("method", METHODS)
def test_a_model_comes_back_as_it_was(method: str, tmp_path: Path) -> None:
    model = taught(method)
    storage.save(model, tmp_path / "model.rpt")
    back = storage.load(tmp_path / "model.rpt")
    left, right = model.answers(QUERIES), back.answers(QUERIES)
    for name in ("output", "gradient", "support", "ids", "groups", "distances", "weights", "expected_error"):
        assert np.array_equal(getattr(left, name), getattr(right, name)), name
    assert (back.settings, back.samples, back.categorical) == (model.settings, 57, (0,))
    more = ([[0.0, 1.0, 0.0]], [[1.0, 1.0]])
    assert back.learn(*more).tolist() == model.learn(*more).tolist() == [60]
    with pytest.raises(ValueError, match="can be forgotten once"):
        back.forget(40)


def test_given_gradients_come_back(tmp_path: Path) -> None:
    model = Model(1, 1, Settings("leaf_map"))
    model.learn([[0.0], [1.0]], [[0.0], [1.0]], gradients=[[[5.0]], [[6.0]]])
    model.learn([[2.0]], [[2.0]])
    storage.save(model, tmp_path / "m")
    assert storage.load(tmp_path / "m").answer([1.1]).output == pytest.approx([1.6])


def test_an_empty_model_comes_back(tmp_path: Path) -> None:
    storage.save(Model(2, 1, radii=[3.0, 1.0]), tmp_path / "m")
    back = storage.load(tmp_path / "m")
    assert back.samples == 0
    back.learn([[0.0, 0.0]], [[1.0]])
    assert back.tree().radii.tolist() == [3.0, 1.0]


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "model.rpt"
    storage.save(taught(), path)
    before = path.read_bytes()

    def full(_number: int) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="no space"):
        storage.save(Model(1, 1), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("storage") / "model.rpt"
    storage.save(taught(), path)
    return path.read_bytes()


def read(data: bytes, path: Path) -> Model:
    path.write_bytes(data)
    return storage.load(path)


@given(data=st.data())
@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_damage_is_noticed(data: st.DataObject, whole: bytes, tmp_path: Path) -> None:
    place = data.draw(st.integers(0, len(whole) - 1))
    if data.draw(st.booleans()):
        damaged = whole[:place]
    else:
        damaged = whole[:place] + bytes([whole[place] ^ data.draw(st.integers(1, 255))]) + whole[place + 1 :]
    with pytest.raises(storage.StorageError):
        read(damaged, tmp_path / "m")


@pytest.mark.parametrize("foreign", [b"", b"PK\x03\x04 something else", b"\x89PNG\r\n\x1a\n" + b"0" * 100])
def test_a_foreign_file_is_named_so(foreign: bytes, tmp_path: Path) -> None:
    with pytest.raises(storage.StorageError, match="is no file of handeye's learner"):
        read(foreign, tmp_path / "m")


def signed(data: bytes) -> bytes:
    return data + hashlib.sha256(data).digest()


def test_a_newer_version_asks_for_an_upgrade(whole: bytes, tmp_path: Path) -> None:
    newer = whole[:8] + (9).to_bytes(4, "little") + whole[12:-32]
    with pytest.raises(storage.StorageError, match=r"version 9; .* upgrade"):
        read(signed(newer), tmp_path / "m")


def change(whole: bytes, edit: Any) -> bytes:
    """The file with its header edited and a sum that fits."""
    length = int.from_bytes(whole[12:20], "little")
    header = json.loads(whole[20 : 20 + length])
    edit(header)
    text = json.dumps(header).encode()
    return signed(whole[:12] + len(text).to_bytes(8, "little") + text + whole[20 + length : -32])


@pytest.mark.parametrize(
    "edit",
    [
        lambda header: header.update(kind="pickle"),
        lambda header: header.pop("values"),
        lambda header: header["values"].update(components=7),
        lambda header: header["values"].update(size=3),
        lambda header: header["values"]["settings"].update(method="magic"),
        lambda header: header["values"]["settings"].update(surprise=1),
        lambda header: header["arrays"][0].update(dtype="|O8"),
        lambda header: header["arrays"][1].update(shape=[10**9, 2]),
        lambda header: header["arrays"][1].update(shape=[-1, 2]),
        lambda header: header["arrays"].pop(),
    ],
)
def test_a_forged_header_with_a_right_sum_is_refused(edit: Any, whole: bytes, tmp_path: Path) -> None:
    with pytest.raises(storage.StorageError, match="does not hold what was asked for"):
        read(change(whole, edit), tmp_path / "m")
