"""The error tree of the command line."""

from __future__ import annotations


class CliError(Exception):
    """A verb can't do its work. `str(error)` says what was wrong and what to do; it is all that the user sees."""


class ProcessDied(CliError):
    """A supervised process ended although nobody asked it to. `name` is its name."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


class NotReady(CliError):
    """Something that was started did not become ready in time."""


class AlreadyRunning(CliError):
    """Another `handeye up` uses the same state directory."""
