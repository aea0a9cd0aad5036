"""The repository's own promises: the namespace, the lock file, the licence."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PORTIONS = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["only-include"]


@pytest.mark.parametrize("portion", PORTIONS)
def test_handeye_stays_one_namespace(portion: str) -> None:
    assert (ROOT / portion).is_dir(), f"{portion} is missing"
    assert not (ROOT / portion / "__init__.py").exists(), f"{portion}/__init__.py would hide the other folders"


def test_the_lock_has_hashes_and_no_addresses() -> None:
    lock = (ROOT / "requirements.txt").read_text()
    assert not re.search(r"https?://|--index-url|--find-links|@ file:", lock)
    pins = re.findall(r"^[A-Za-z0-9_.\[\]-]+==", lock, re.MULTILINE)
    blocks = re.split(r"^(?=[A-Za-z0-9_.\[\]-]+==)", lock, flags=re.MULTILINE)[1:]
    assert len(pins) == len(blocks)
    assert all("--hash=sha256:" in block for block in blocks)


def test_the_lock_covers_every_dependency() -> None:
    extras = PROJECT["project"]["optional-dependencies"]
    wanted = [*PROJECT["project"]["dependencies"], *(r for group in extras.values() for r in group)]
    names = {re.split(r"[<>=!~;\[ ]", r, maxsplit=1)[0].lower() for r in wanted} - {"handeye"}
    locked = {
        name.lower()
        for name in re.findall(r"^([A-Za-z0-9_.-]+)==", (ROOT / "requirements.txt").read_text(), re.MULTILINE)
    }
    assert not names - locked, "run `make lock`"
