"""The asynchronous client in the shape of the synchronous one, so that one test does for both."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Iterator
from typing import Any


class Blocking:
    """An `AsyncClient` (or what it gave) that is used as if it were a `Client`."""

    def __init__(self, inner: Any, runner: asyncio.Runner) -> None:
        self._inner = inner
        self._runner = runner

    def __getattr__(self, name: str) -> Any:
        return self._now(getattr(self._inner, name))

    def _now(self, value: Any) -> Any:
        if inspect.isawaitable(value):
            return self._runner.run(_awaited(value))
        if inspect.isasyncgen(value):
            return self._pulled(value)
        if hasattr(value, "__aenter__"):
            return Blocking(value, self._runner)
        if callable(value):
            return lambda *given, **named: self._now(value(*given, **named))
        return value

    def _pulled(self, stream: Any) -> Iterator[Any]:
        try:
            while True:
                yield self._runner.run(_awaited(anext(stream)))
        except StopAsyncIteration:
            return
        finally:
            self._runner.run(stream.aclose())

    def __enter__(self) -> Any:
        return self._now(self._inner) if self._now(self._inner.__aenter__()) is None else self

    def __exit__(self, *how: Any) -> None:
        self._now(self._inner.__aexit__(*how))


async def _awaited(value: Any) -> Any:
    return await value
