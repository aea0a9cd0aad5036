"""What every role's process does alike: log to stderr, end when it is told to."""

import os
import select
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import structlog


def configure_logging() -> None:
    """structlog to stderr, context variables too: for people on a terminal, one JSON object a line elsewhere."""
    # Plain tracebacks: the pretty ones show local variables, passwords too.
    console = structlog.dev.ConsoleRenderer(exception_formatter=structlog.dev.plain_traceback)
    steps, context = structlog.processors, structlog.contextvars.merge_contextvars
    render = [console] if sys.stderr.isatty() else [steps.format_exc_info, steps.JSONRenderer()]
    processors: list[Any] = [context, steps.add_log_level, steps.TimeStamper(fmt="iso"), *render]
    structlog.configure(processors=processors, logger_factory=structlog.PrintLoggerFactory(sys.stderr))


@contextmanager
def until_stopped(watch_parent: bool = False, grace: float = 30.0) -> Iterator[threading.Event]:
    """Gives an Event that is set on SIGTERM, on SIGINT and, with `watch_parent`, when stdin ends: the parent died.

    For the main thread; the signals' former handlers are back after the block. A process whose block has not ended
    `grace` s after it was told to is ended, so that none is left over.
    """
    stop, over = threading.Event(), threading.Event()
    told, tell = os.pipe()

    def watch() -> None:
        poll = select.poll()
        for source in [told, 0] if watch_parent else [told]:
            poll.register(source, select.POLLIN)
        with suppress(OSError):  # no stdin at all is an ended one
            while not any(source == told or not os.read(source, 4096) for source, _event in poll.poll()):
                pass
        stop.set()
        if not over.wait(grace):
            os._exit(1)

    def tell_watcher(*_: object) -> None:
        os.write(tell, b"!")  # setting the Event here could interrupt a `stop.wait` that holds the Event's lock

    handlers = {number: signal.signal(number, tell_watcher) for number in (signal.SIGTERM, signal.SIGINT)}
    watcher = threading.Thread(target=watch, name="until stopped", daemon=True)
    watcher.start()
    try:
        yield stop
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        over.set()
        tell_watcher()
        watcher.join()
        os.close(told)
        os.close(tell)
