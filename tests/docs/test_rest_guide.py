"""Every example of the REST guide, run as it stands and in its order, against the service in a toy world."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import sys
import threading
from contextlib import closing
from pathlib import Path

import pytest

from handeye.server.serve import http_server
from handeye.server.store import Store
from tests.server.conftest import TOKEN, open_lab

GUIDE = (Path(__file__).parents[2] / "docs" / "rest.md").read_text()


def script() -> str:
    """All blocks as one script, as a reader would type them into one shell."""
    parts = ["shopt -s expand_aliases"]  # an interactive shell has them
    for language, code in re.findall(r"```(sh|python)\n(.*?)```", GUIDE, re.DOTALL):
        parts.append(code if language == "sh" else f"{sys.executable} - <<'PYTHON'\n{code}PYTHON")
    return "\n".join(parts)


@pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed")
def test_every_example_works(tmp_path: Path) -> None:
    stop = threading.Event()
    with (
        Store.open(f"sqlite:///{tmp_path / 'handeye.db'}") as store,
        open_lab(store) as lab,
        closing(socket.create_server(("127.0.0.1", 0))) as listener,
        http_server(lab.app(), listener, stop),
        closing(lab.coordinator),
    ):
        environment = os.environ | {
            "HANDEYE_URL": f"http://127.0.0.1:{listener.getsockname()[1]}",
            "HANDEYE_TOKEN": TOKEN,
        }
        done = subprocess.run(
            ["bash", "-euxo", "pipefail", "-c", script()],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            timeout=100,
            check=False,
        )
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "look.jpg").read_bytes()[:2] == b"\xff\xd8"
    assert (tmp_path / "observer.png").read_bytes()[1:4] == b"PNG"
    assert (tmp_path / "right.npy").read_bytes()[1:6] == b"NUMPY"
    assert '"subtasks"' in done.stdout
    assert "handeye_requests_total" in done.stdout
    ended = re.findall(r'"state": ?"(\w+)"', (tmp_path / "events.txt").read_text())
    assert ended.count("succeeded") == 7
