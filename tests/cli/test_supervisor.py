"""Children are watched, ended in order, and never outlive this process. Small real processes stand in for roles."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from handeye.cli.errors import NotReady, ProcessDied
from handeye.cli.supervisor import Child, Supervisor, Terminated, signals_unwind

# Ends when its stdin closes, as every role's verb does.
OBEDIENT = "import sys; print('started', flush=True); sys.stdin.read()"
STUBBORN = (
    "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('started', flush=True)\n"
    "while True: time.sleep(1)"
)


def start(supervisor: Supervisor, name: str, code: str) -> Child:
    return supervisor.start(name, [sys.executable, "-c", code], os.environ)


def started(child: Child) -> Callable[[], bool]:
    def seen() -> bool:
        assert child.log is not None
        return "started" in child.log.read_text()

    return seen


def wait_for(condition: Callable[[], bool], timeout: float = 10.0) -> None:
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, "the condition did not come true"
        time.sleep(0.01)


def process_state(pid: int) -> str:
    """The kernel's letter for the process's state; empty when there is none."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return ""


def alive(pid: int) -> bool:
    return process_state(pid) not in ("", "Z")


def test_closing_tells_all_children_before_it_waits_for_one(tmp_path: Path, no_orphans: Callable[[], set[int]]) -> None:
    # Each ends only once all of them have been told to.
    code = (
        "import pathlib, signal, sys, time\n"
        f"told = pathlib.Path({str(tmp_path)!r})\n"
        "def end(*_):\n"
        "    (told / f'told-{sys.argv[1]}').touch()\n"
        "    while len(list(told.glob('told-*'))) < 3: time.sleep(0.01)\n"
        "    sys.exit(0)\n"
        "signal.signal(signal.SIGTERM, end); print('started', flush=True); sys.stdin.read()"
    )
    with Supervisor(tmp_path) as supervisor:
        children = [supervisor.start(name, [sys.executable, "-c", code, name], os.environ) for name in "abc"]
        for child in children:
            supervisor.wait_until(started(child), 10, child.name)
    assert [child.returncode for child in children] == [0, 0, 0]
    assert no_orphans() == set()


def test_a_child_that_ignores_term_is_killed(tmp_path: Path, no_orphans: Callable[[], set[int]]) -> None:
    with Supervisor(tmp_path, grace=0.2) as supervisor:
        child = start(supervisor, "mule", STUBBORN)
        supervisor.wait_until(started(child), 10, "mule")
    assert child.returncode == -signal.SIGKILL
    assert no_orphans() == set()


def test_a_frozen_child_is_killed(tmp_path: Path) -> None:
    with Supervisor(tmp_path, grace=0.2) as supervisor:
        child = start(supervisor, "ice", OBEDIENT)
        supervisor.wait_until(started(child), 10, "ice")
        os.kill(child.pid, signal.SIGSTOP)
        wait_for(lambda: process_state(child.pid) == "T")
    assert child.returncode == -signal.SIGKILL


def test_a_death_is_told_with_name_signal_and_log(tmp_path: Path) -> None:
    with Supervisor(tmp_path) as supervisor:
        start(supervisor, "router", OBEDIENT)
        child = start(supervisor, "camera bridge", OBEDIENT)
        supervisor.wait_until(started(child), 10, "camera bridge")
        supervisor.check()
        os.kill(child.pid, signal.SIGKILL)
        with pytest.raises(ProcessDied, match="camera bridge was killed by SIGKILL") as caught:
            supervisor.run_forever()
        assert caught.value.name == "camera bridge"
        assert "started" in str(caught.value)


def test_readiness_ends_early_when_a_child_dies(tmp_path: Path) -> None:
    with Supervisor(tmp_path) as supervisor:
        start(supervisor, "server", "import sys; sys.exit('no database')")
        with pytest.raises(ProcessDied, match=r"server ended with exit code 1\n.*no database"):
            supervisor.wait_until(lambda: False, 10, "the server")


def test_readiness_has_a_deadline(tmp_path: Path) -> None:
    with Supervisor(tmp_path) as supervisor:
        start(supervisor, "server", OBEDIENT)
        with pytest.raises(NotReady, match=r"within 0\.1 s"):
            supervisor.wait_until(lambda: False, 0.1, "the server")


def test_finish_waits_for_one_child_and_fails_with_it(tmp_path: Path) -> None:
    with Supervisor(tmp_path) as supervisor:
        start(supervisor, "server", OBEDIENT)
        supervisor.finish(start(supervisor, "teacher", "pass"))
        assert [child.name for child in supervisor.children] == ["server"]
        with pytest.raises(ProcessDied, match="teacher ended with exit code 3"):
            supervisor.finish(start(supervisor, "teacher", "raise SystemExit(3)"))


def test_term_unwinds_and_an_ignored_hup_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with signals_unwind():
            os.kill(os.getpid(), signal.SIGHUP)
            with pytest.raises(Terminated) as caught:
                signal.raise_signal(signal.SIGTERM)
        assert caught.value.code == 143
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_no_child_outlives_the_parent(tmp_path: Path, end: signal.Signals) -> None:
    code = (
        "import os, sys\n"
        "from pathlib import Path\n"
        "from handeye.cli.supervisor import Supervisor, signals_unwind\n"
        f"with signals_unwind(), Supervisor(Path({str(tmp_path)!r})) as supervisor:\n"
        f"    children = [supervisor.start(n, [sys.executable, '-c', {OBEDIENT!r}], os.environ) for n in 'ab']\n"
        "    print(*(child.pid for child in children), flush=True)\n"
        "    supervisor.run_forever()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as parent:
        assert parent.stdout is not None
        pids = [int(pid) for pid in parent.stdout.readline().split()]
        assert len(pids) == 2
        assert all(alive(pid) for pid in pids)
        parent.send_signal(end)
        assert parent.wait(20) != 0
    wait_for(lambda: not any(alive(pid) for pid in pids))
