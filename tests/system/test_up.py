"""`handeye up` and `handeye demo` with their real processes: ready, and gone without a trace however they end."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from handeye.cli import state
from handeye.client import Client

if TYPE_CHECKING:
    from tests.system.conftest import Processes

pytestmark = pytest.mark.system

START_LIMIT = 60.0
END_LIMIT = 30.0
VERBS = {"router", "robot-bridge", "camera-bridge", "server"}


class Up:
    """A running `handeye up`, ready."""

    def __init__(self, process: subprocess.Popen[bytes], directory: Path, processes: Processes) -> None:
        self.process = process
        self.directory = directory
        self.children = processes.children_of(process.pid)
        self._processes = processes

    def said(self) -> str:
        return (self.directory / "stderr").read_text()

    def expect_nothing_left(self) -> None:
        def gone() -> bool:
            return not any(self._processes.alive(pid) for pid in self.children.values())

        self._processes.wait_for(gone, END_LIMIT, f"all of {self.children} have ended")


@contextmanager
def up(directory: Path, processes: Processes) -> Iterator[Up]:
    with processes.running("up", "--state-dir", str(directory), stderr=directory / "stderr") as process:

        def ready() -> bool:
            said = (directory / "stderr").read_text()
            assert process.poll() is None, said
            return said.startswith("ready: http://127.0.0.1:")

        processes.wait_for(ready, START_LIMIT, "`handeye up` is ready")
        yield Up(process, directory, processes)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["INT", "TERM"])
def test_it_is_ready_and_ends_cleanly_on_a_signal(tmp_path: Path, processes: Processes, number: signal.Signals) -> None:
    # What a stack that was killed has left in the directory is in nobody's way.
    (tmp_path / state.SERVER_FILE).write_text("left by another")
    with up(tmp_path, processes) as stack:
        assert set(stack.children) == VERBS
        for name in (state.SERVER_FILE, state.LAB_FILE):
            assert stat.S_IMODE((tmp_path / name).stat().st_mode) == 0o600
        kept = state.read_private(tmp_path / state.SERVER_FILE)
        with Client(str(kept["url"]), str(kept["token"])) as client:
            assert client.not_ready() is None
            assert client.robot().world_time >= 0.0
        stack.process.send_signal(number)
        assert stack.process.wait(END_LIMIT) == 128 + number
        stack.expect_nothing_left()
        assert not (tmp_path / state.SERVER_FILE).exists()
        assert not (tmp_path / state.LAB_FILE).exists()
        assert "Traceback" not in stack.said()
        for log in (tmp_path / "logs").iterdir():
            assert "Traceback" not in log.read_text(), log.name


@pytest.mark.parametrize("verb", sorted(VERBS))
def test_a_killed_process_ends_all_with_a_message(tmp_path: Path, processes: Processes, verb: str) -> None:
    with up(tmp_path, processes) as stack:
        os.kill(stack.children[verb], signal.SIGKILL)
        assert stack.process.wait(END_LIMIT) == 1
        assert f"the {verb.replace('-', ' ')} was killed by SIGKILL" in stack.said()
        stack.expect_nothing_left()
        assert not (tmp_path / state.SERVER_FILE).exists()


def test_no_process_outlives_a_killed_parent(tmp_path: Path, processes: Processes) -> None:
    with up(tmp_path, processes) as stack:
        stack.process.kill()
        stack.process.wait()
        stack.expect_nothing_left()


def test_a_second_stack_in_the_same_directory_is_refused(tmp_path: Path, processes: Processes) -> None:
    with state.exclusive(tmp_path):
        with processes.running("up", "--state-dir", str(tmp_path), stderr=tmp_path / "stderr") as process:
            assert process.wait(START_LIMIT) == 1
        assert "is in use by process" in (tmp_path / "stderr").read_text()


def test_a_demonstration_ends_with_the_name_of_what_died(tmp_path: Path, processes: Processes) -> None:
    report = tmp_path / "report"
    with processes.running("demo", "--trials", "1", "--report", str(report), stderr=tmp_path / "stderr") as demo:

        def teaching() -> bool:
            assert demo.poll() is None, (tmp_path / "stderr").read_text()
            return "teach" in processes.children_of(demo.pid)

        processes.wait_for(teaching, START_LIMIT, "the teacher has been started")
        children = processes.children_of(demo.pid)
        os.kill(children["camera-bridge"], signal.SIGKILL)
        assert demo.wait(END_LIMIT) == 1
        assert "the camera bridge was killed by SIGKILL" in (tmp_path / "stderr").read_text()
        processes.wait_for(
            lambda: not any(map(processes.alive, children.values())), END_LIMIT, f"all of {children} have ended"
        )
    assert {log.stem for log in (report / "logs").iterdir()} >= VERBS
