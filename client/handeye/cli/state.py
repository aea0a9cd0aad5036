"""The state directory: where a running stack says how to reach it.

`handeye.json` holds {"url", "token"} of the coordinator; `lab.json` holds the settings of the acting bus and of the
lab bus as environment variables, for the teacher, for scoring and for tests. Both are readable by their owner only
and are gone when the stack is. `logs/` holds one log per process.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from handeye.cli.errors import AlreadyRunning, CliError

SERVER_FILE = "handeye.json"
LAB_FILE = "lab.json"


def default_state_dir() -> Path:
    """`$XDG_STATE_HOME/handeye`, else `~/.local/state/handeye`: where `handeye.client` looks for the coordinator."""
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "handeye"


def write_private(path: Path, content: Mapping[str, object]) -> None:
    """Writes `content` as JSON to `path`, at once and with mode 0600 from the first byte on."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.unlink(missing_ok=True)
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w") as file:
        json.dump(content, file, indent=2)
        file.write("\n")
    temporary.replace(path)


def read_private(path: Path) -> dict[str, object]:
    """The JSON object in `path`; `CliError` when there is none."""
    try:
        content = json.loads(path.read_text())
    except FileNotFoundError:
        raise CliError(f"{path} does not exist: is `handeye up` running?") from None
    except ValueError as error:
        raise CliError(f"{path} is not JSON ({error}): restart `handeye up`") from None
    if not isinstance(content, dict):
        raise CliError(f"{path} holds no JSON object: restart `handeye up`")
    return content


@contextmanager
def exclusive(state_dir: Path) -> Iterator[None]:
    """Holds the state directory for this process; `AlreadyRunning` when another one does.

    The lock is the kernel's, so it ends with the process however that ends.
    """
    state_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
    with (state_dir / "lock").open("a+") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.seek(0)
            raise AlreadyRunning(
                f"{state_dir} is in use by process {lock.read().strip() or 'unknown'}: "
                "stop it first, or give --state-dir for a second stack"
            ) from None
        lock.truncate(0)
        lock.write(str(os.getpid()))
        lock.flush()
        yield
