"""The generated code in the repository is what the `.proto` files give."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import handeye.proto.v1

COMMITTED = Path(handeye.proto.v1.__path__[0])
ROOT = COMMITTED.parents[2]


@pytest.mark.timeout(120)
def test_generated_code_is_current(tmp_path: Path) -> None:
    sources = sorted(COMMITTED.glob("*.proto"))
    plugin = f"--plugin=protoc-gen-mypy={Path(sys.executable).with_name('protoc-gen-mypy')}"
    outputs = [plugin, f"--python_out={tmp_path}", f"--mypy_out={tmp_path}"]
    command = [sys.executable, "-m", "grpc_tools.protoc", "-I", str(ROOT), *outputs, *map(str, sources)]
    subprocess.run(command, check=True, timeout=100)
    generated = {path.name: path.read_text() for path in tmp_path.rglob("*_pb2.py*")}
    assert len(generated) == 2 * len(sources)
    committed = {path.name: path.read_text() for path in COMMITTED.glob("*_pb2.py*")}
    stale = sorted(name for name in generated | committed if generated.get(name) != committed.get(name))
    assert not stale, f"run `make proto`: {stale} differ from the .proto files"
