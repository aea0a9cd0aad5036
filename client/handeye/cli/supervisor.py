"""Starts processes, notices when one dies, and leaves none behind.

Every child gets a pipe as stdin whose other end only this process holds, and is started with `--watch-parent`: when
this process dies, however it dies, the pipe closes and the child shuts itself down. Children run in sessions of
their own, so that Ctrl-C reaches this process only, which then ends them in order.
"""

from __future__ import annotations

import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType, TracebackType
from typing import Self

from handeye.cli.errors import NotReady, ProcessDied

POLL = 0.02
"""How often children and readiness are looked at, in s."""

TAIL_LINES = 12
"""How many of a dead process's last log lines are shown."""


class Terminated(SystemExit):
    """TERM or HUP arrived; unwinds to the end of the process, with 128 + signal as exit code, as shells have it."""

    def __init__(self, signum: int) -> None:
        super().__init__(128 + signum)


@contextmanager
def signals_unwind() -> Iterator[None]:
    """Inside, TERM and HUP raise `Terminated` in the main thread, so that context managers close what is open."""

    def unwind(signum: int, _frame: FrameType | None) -> None:
        raise Terminated(signum)

    with _handling(unwind, signal.SIGTERM, signal.SIGHUP):
        yield


@contextmanager
def _handling(handler: Callable[[int, FrameType | None], None] | signal.Handlers, *numbers: int) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # What is ignored from the start stays ignored: `nohup` and shells' background jobs mean it so.
    heeded = [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, handler) for number in heeded}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


class Child:
    """A running process with a name and a log."""

    def __init__(self, name: str, command: Sequence[str], environment: Mapping[str, str], log: Path | None) -> None:
        self.name = name
        self.log = log
        with ExitStack() as files:
            sink = None if log is None else files.enter_context(log.open("wb"))
            self._process = subprocess.Popen(
                list(command),
                stdin=subprocess.PIPE,
                stdout=sink,
                stderr=sink,
                env=dict(environment),
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def returncode(self) -> int | None:
        """Exit code, negative signal number, or None while the process runs."""
        return self._process.poll()

    def death(self) -> str:
        """How the process ended, as a sentence, with the end of its log."""
        code = self._process.poll()
        if code is None:
            return f"the {self.name} is running"
        how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
        return f"the {self.name} {how}{self._log_tail()}"

    def terminate(self) -> None:
        """Tells the process to end, by TERM."""
        self._process.terminate()

    def end(self, deadline: float) -> None:
        """Waits until the process is gone; KILL at `deadline` (`time.monotonic`)."""
        try:
            self._process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdin is not None:
            self._process.stdin.close()

    def _log_tail(self) -> str:
        if self.log is None:
            return ""
        lines = self.log.read_text(errors="replace").splitlines()[-TAIL_LINES:]
        return "".join(f"\n    {line}" for line in lines) + f"\n    (log: {self.log})"


class Supervisor:
    """The children of this process. Closing it tells all of them to end, the last one started first."""

    def __init__(self, log_dir: Path, grace: float = 15.0) -> None:
        """Logs go to `log_dir`; a child that does not end within `grace` s of TERM is killed.

        The server's own limits for its end add up to less.
        """
        self._log_dir = log_dir
        self._grace = grace
        self.children: list[Child] = []

    def start(self, name: str, command: Sequence[str], environment: Mapping[str, str], *, logged: bool = True) -> Child:
        """Starts a process; its output goes to the log `<name>.log`, or to this terminal if not `logged`."""
        self._log_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
        log = self._log_dir / f"{name.replace(' ', '-')}.log" if logged else None
        child = Child(name, command, environment, log)
        self.children.append(child)
        return child

    def check(self) -> None:
        """`ProcessDied` if a child has ended."""
        for child in self.children:
            if child.returncode is not None:
                raise ProcessDied(child.name, child.death())

    def wait_until(self, ready: Callable[[], bool], timeout: float, what: str) -> None:
        """Waits until `ready()`; `ProcessDied` when a child dies first, `NotReady` after `timeout` s."""
        deadline = time.monotonic() + timeout
        while not ready():
            self.check()
            if time.monotonic() > deadline:
                raise NotReady(f"{what} did not become ready within {timeout:g} s; logs: {self._log_dir}")
            time.sleep(POLL)

    def finish(self, child: Child) -> None:
        """Waits for `child` to end with exit code 0 and forgets it; `ProcessDied` if it or another one fails."""
        while child.returncode is None:
            self.check()
            time.sleep(POLL)
        if child.returncode != 0:
            raise ProcessDied(child.name, child.death())
        self.children.remove(child)
        child.end(time.monotonic())

    def run_forever(self) -> None:
        """Returns never: ends by `ProcessDied`, `KeyboardInterrupt` or `Terminated`."""
        while True:
            self.check()
            time.sleep(POLL)

    def close(self) -> None:
        """Stops all children; signals that arrive meanwhile don't interrupt it."""
        with _handling(signal.SIG_IGN, signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            for child in reversed(self.children):
                child.terminate()
            deadline = time.monotonic() + self._grace
            while self.children:
                self.children[-1].end(deadline)
                self.children.pop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
