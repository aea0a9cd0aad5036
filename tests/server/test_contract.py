"""The acting side cannot reach the simulator: not by import, however far."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from handeye.robot_bridge.driver import RobotDriver
from handeye.server.acting import LeasedRobot

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


def test_the_import_contracts_hold() -> None:
    script = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    root = Path(__file__).parents[2]  # where pyproject.toml has the contracts
    done = subprocess.run(
        [sys.executable, "-c", script, "--no-cache"], cwd=root, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert " 0 broken" in done.stdout


def test_what_the_acting_side_holds_has_no_inverse_kinematics() -> None:
    by_coordinates = {"move_to_point", "move_to_joints", "park"}
    assert by_coordinates <= set(dir(RobotDriver))
    assert not by_coordinates & set(dir(LeasedRobot))
