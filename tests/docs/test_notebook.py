"""The example notebook runs from its first cell to its last, in a folder of its own."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import matplotlib
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_own_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    matplotlib.use("agg")
    from matplotlib import pyplot as plt

    shutil.copy(EXAMPLES / "arm.csv", tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plt, "show", lambda: None)
    notebook = json.loads((EXAMPLES / "own_data.ipynb").read_text())
    names: dict[str, object] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] or cell is notebook["cells"][-1], f"{cell['id']} was never run"
            exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
    plt.close("all")
    printed = capsys.readouterr().out
    assert printed.count(" ok  from sweeps") == 2
    assert printed.count("NOT TAUGHT") == 1
    assert (tmp_path / "arm.rpt").exists()
