"""Makes `benchmarks` importable: it is not installed."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import sklearn

sys.path.insert(0, str(Path(__file__).parents[2]))


@pytest.fixture(autouse=True)
def scikit_learn_as_it_was() -> Iterator[None]:
    """The benchmark tells scikit-learn for good that its input is finite: other tests must not hear of it."""
    with sklearn.config_context():
        yield
