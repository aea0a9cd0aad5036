"""Entry point of the `handeye` command."""

from __future__ import annotations

import sys


def main() -> None:
    """Runs the command line of `sys.argv` and exits with its code."""
    try:
        from handeye.cli.app import run
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] == "handeye":
            raise
        sys.exit(f"handeye: the command line needs {error.name!r}, which is not installed: pip install 'handeye[cli]'")
    sys.exit(run(sys.argv[1:]))


if __name__ == "__main__":
    main()
