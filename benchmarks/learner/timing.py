"""Times several systems in turns, so that whatever else the machine does hits all of them."""

from __future__ import annotations

import gc
import random
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import cycle, islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Times = NDArray[np.float64]
"""(rounds,) µs per call, one mean for each round."""


class Timed(NamedTuple):
    """What is called, as call(argument, k), and its arguments: the same queries for all, each in its own form."""

    call: Callable[[Any, int], object]
    arguments: Sequence[Any]


def in_turns(systems: Mapping[str, Timed], k: int, *, rounds: int, calls: int) -> dict[str, Times]:
    """µs per call of every system in each of `rounds` rounds of `calls` calls.

    In a round each system gets the same stretch of the queries; the next round goes on where it stopped, and begins
    anew at the end. A quarter as many calls before the stretch are not counted: they find in the caches what the
    system before has left there. The order within a round is shuffled; one round before the first is not counted. No
    garbage is collected while the clock runs; reading it and the loop cost less than 0.05 µs per call at 10 calls or
    more.
    """
    order = list(systems)
    shuffle = random.Random(1).shuffle
    endless = {name: cycle(timed.arguments) for name, timed in systems.items()}
    taken: dict[str, list[float]] = {name: [] for name in systems}
    for number in range(rounds + 1):
        shuffle(order)
        with _no_collection():
            for name in order:
                call = systems[name].call
                _microseconds(call, list(islice(endless[name], calls // 4)), k)
                spent = _microseconds(call, list(islice(endless[name], calls)), k)
                if number > 0:
                    taken[name].append(spent)
    return {name: np.array(spent) for name, spent in taken.items()}


def ratio(times: Times, base: Times) -> float:
    """How many times as long as `base`: the median of the rounds' ratios, so slow spells of the machine cancel."""
    return float(np.median(times / base))


def _microseconds(call: Callable[[Any, int], object], arguments: Sequence[Any], k: int) -> float:
    begin = time.perf_counter_ns()
    for argument in arguments:
        call(argument, k)
    return (time.perf_counter_ns() - begin) / max(len(arguments), 1) / 1e3


@contextmanager
def _no_collection() -> Iterator[None]:
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
