"""Log lines of the server's process: how much is written, and that libraries' lines look like our own."""

from __future__ import annotations

import logging
from typing import Literal

import structlog

Level = Literal["debug", "info", "warning", "error"]


class _ToStructlog(logging.Handler):
    """Hands the standard library's records to structlog."""

    def emit(self, record: logging.LogRecord) -> None:
        try:
            structlog.get_logger(record.name).log(
                record.levelno, record.getMessage().strip(), logger=record.name, exc_info=record.exc_info
            )
        except Exception:
            self.handleError(record)


def configure_level(level: Level) -> None:
    """Leaves out lines below `level`, and takes libraries' warnings and errors in. After `configure_logging`."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(level))
    logging.basicConfig(handlers=[_ToStructlog()], level=logging.WARNING, force=True)
