from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from handeye.cli.up import Stack
from handeye.client import Client
from handeye.proto.methods import ROBOT_STATE
from handeye.rpc import Bus
from handeye.simulation.experimenter import Experimenter, volume_views
from handeye.simulation.lab import LabClient
from handeye.simulation.objects import CUPS, ObjectSpec
from handeye.simulation.places import Purpose, draw
from handeye.simulation.teaching import acting_settings, lab_settings, teach

END_LIMIT = 30.0

TASK = "grasp"
OBJECT = "blue cup"
SEED = 3
TAUGHT_PLACE = draw(SEED, Purpose.TEACHING, 1)[0]


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "handeye.cli.main", *arguments]


class Processes:
    """What the tests ask of the operating system."""

    def alive(self, pid: int) -> bool:
        return self._status(pid)[0] not in ("", "Z")

    def children_of(self, pid: int) -> dict[str, int]:
        """The living `handeye` children of `pid`: verb → process id."""
        found = {}
        for entry in Path("/proc").iterdir():
            if not entry.name.isdigit():
                continue
            state, parent = self._status(int(entry.name))
            if parent != pid or state in ("", "Z"):
                continue
            words = (entry / "cmdline").read_text().split("\0")
            if "handeye.cli.main" in words:
                found[words[words.index("handeye.cli.main") + 1]] = int(entry.name)
        return found

    def wait_for(self, condition: Callable[[], bool], timeout: float, what: str) -> None:
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, f"not within {timeout} s: {what}"
            time.sleep(0.02)

    @contextmanager
    def running(self, *arguments: str, stderr: Path) -> Iterator[subprocess.Popen[bytes]]:
        """A `handeye` process in a session of its own; ended at the end if the test left it running."""
        with stderr.open("wb") as sink:
            process = subprocess.Popen(command(*arguments), stdout=sink, stderr=sink, start_new_session=True)
        try:
            yield process
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                try:
                    process.wait(END_LIMIT)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()

    @staticmethod
    def _status(pid: int) -> tuple[str, int]:
        """The kernel's letter for the process's state and its parent; ("", 0) when there is none."""
        try:
            state, parent = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[:2]
        except OSError:
            return "", 0
        return state, int(parent)


@dataclass(frozen=True)
class Lesson:
    """A running stack whose coordinator was taught."""

    stack: Stack
    client: Client
    lab: LabClient

    def reset(self) -> None:
        """An empty world, the arm parked and free to move."""
        if self.client.robot().stopped:
            self.client.reset_robot()
        self.lab.reset(5)

    def place(
        self, xy: tuple[float, float] = (TAUGHT_PLACE.x, TAUGHT_PLACE.y), spec: ObjectSpec = CUPS[OBJECT]
    ) -> None:
        self.lab.place(spec, xy, 0.4)

    def run(self, meanwhile: Callable[[], None] = lambda: None) -> tuple[int, str]:
        """`handeye run` until it ends: exit code, and what it said on stderr. `meanwhile` is called while it runs."""
        environment = os.environ | {"HANDEYE_URL": self.stack.url, "HANDEYE_TOKEN": self.stack.token}
        with subprocess.Popen(
            command("run", TASK, "--object", OBJECT), env=environment, stderr=subprocess.PIPE, text=True
        ) as process:
            try:
                meanwhile()
                said = process.communicate(timeout=60)[1]
            except BaseException:
                process.kill()
                raise
        return process.returncode, said

    def catch_in_motion(self, then: Callable[[], None]) -> None:
        """Calls `then` as soon as the arm moves."""
        with Bus.open(acting_settings(self.stack.acting), name="tests") as bus, bus.subscribe(ROBOT_STATE) as states:
            deadline = time.monotonic() + 30.0
            while time.monotonic() < deadline:
                state = states.newest(1.0)
                if state is not None and max(map(abs, state.velocities)) > 0.02:
                    then()
                    return
        raise AssertionError("the arm did not move")

    def process(self, name: str) -> int:
        """Process id of one of the stack's processes."""
        return next(child.pid for child in self.stack.supervisor.children if child.name == name)


@pytest.fixture(scope="session")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    with pytest.MonkeyPatch.context() as patch:
        # Slow motions, so that a test can catch the arm in the midst of one.
        patch.setenv("HANDEYE_SERVER_ACTING__PACE", "0.1")
        # Named so that XDG_STATE_HOME leads to it.
        with Stack(tmp_path_factory.mktemp("state") / "handeye") as stack:
            yield stack


@pytest.fixture(scope="session")
def lesson(stack: Stack) -> Iterator[Lesson]:
    with (
        Client(stack.url, stack.token) as client,
        Bus.open(lab_settings(stack.lab), name="tests") as bus,
    ):
        lab = LabClient(bus)
        # With CSS two demonstrations are enough for the whole table.
        experimenter = Experimenter(lab, client, SEED)
        experimenter.show_grid(volume_views(np.random.default_rng(SEED), depths=6), lambda: None)
        teach(demonstrations=2, seed=SEED, task=TASK, object_name=OBJECT, state_dir=stack.state_dir, watch_parent=False)
        assert client.train(TASK).frame == "hand"
        yield Lesson(stack, client, lab)


@pytest.fixture
def processes() -> Processes:
    return Processes()
