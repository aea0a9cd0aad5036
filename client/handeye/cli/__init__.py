"""The `handeye` command. Its verbs come from the roles that are installed (entry points group `handeye.verbs`).

The package imports nothing of the other roles; it finds them by entry point and starts them as processes.
"""

from handeye.cli.errors import CliError

__all__ = ["CliError"]
