"""The code on the learner's pages, run as it stands."""

from __future__ import annotations

import doctest
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs" / "learner"


@pytest.mark.parametrize("page", ["using.md", "when-not.md"])
def test_the_examples_print_what_the_page_says(page: str) -> None:
    failed, tried = doctest.testfile(str(DOCS / page), module_relative=False)
    assert tried
    assert not failed
