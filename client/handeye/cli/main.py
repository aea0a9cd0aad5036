"""Entry point of the `handeye` command."""

from __future__ import annotations

import os
import sys


def main() -> None:
    """Runs the command line of `sys.argv` and exits with its code."""
    # Before numpy is imported: its threads gain nothing on matrices as small as ours, and where processes share cores
    # they wait for each other ten times longer than they work.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from handeye.cli.app import run
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] == "handeye":
            raise
        sys.exit(f"handeye: the command line needs {error.name!r}, which is not installed: pip install 'handeye[cli]'")
    sys.exit(run(sys.argv[1:]))


if __name__ == "__main__":
    main()
