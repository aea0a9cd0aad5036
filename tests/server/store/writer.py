"""Writes batches of samples until it is killed: python -m tests.server.store.writer URL FIRST_BATCH."""

from __future__ import annotations

import itertools
import sys

from handeye.server.store import Store, modules
from tests.server.store.killing import DECLARATION, samples_of


def main(url: str, first_batch: int) -> None:
    with Store.open(url) as store:
        with store.write() as connection:
            if modules.get(connection, DECLARATION.name) is None:
                modules.create(connection, DECLARATION)
        for number in itertools.count(first_batch):
            count = size_of(number)
            with store.write() as connection:
                inputs, outputs = samples_of(number, count)
                first = modules.add_samples(connection, DECLARATION.name, inputs, outputs, [f"shown-{number}"] * count)
            print(number, count, first, flush=True)


def size_of(number: int) -> int:
    """How many samples a batch has: from one to a few thousand."""
    share = number * 2654435761 % 2**32 / 2**32
    return 1 + int(3000 * share**4)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
