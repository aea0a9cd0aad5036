"""The acting side cannot reach the simulator: not by import, however far."""

from __future__ import annotations

import subprocess
import sys

import pytest

EVERYTHING = """
import importlib, pkgutil, sys
for package in {packages}:
    root = importlib.import_module(package)
    for module in pkgutil.walk_packages(root.__path__, package + "."):
        importlib.import_module(module.name)
assert "{proof}" in sys.modules
print(sorted(name for name in sys.modules if name.startswith({forbidden})))
"""


@pytest.mark.parametrize(
    ("packages", "proof", "forbidden"),
    [
        (("handeye.server", "handeye.modules"), "handeye.server.serve", ("pybullet", "handeye.simulation")),
        (
            ("handeye.client",),
            "handeye.client.verbs",
            ("pybullet", "handeye.s", "handeye.r", "handeye.m", "handeye.proto", "handeye.camera", "zenoh", "fastapi"),
        ),
    ],
)
def test_importing_all_of_it_imports_nothing_forbidden(
    packages: tuple[str, ...], proof: str, forbidden: tuple[str, ...]
) -> None:
    script = EVERYTHING.format(packages=(*packages,), proof=proof, forbidden=forbidden)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"
