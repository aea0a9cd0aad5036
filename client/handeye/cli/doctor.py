"""`handeye doctor`: says what is missing on this machine and how to mend it."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from handeye.cli import state
from handeye.cli.up import free_ports

PROBE_TIMEOUT = 60.0
"""Longest time one package may take to import, in s."""


@dataclass(frozen=True, slots=True)
class Finding:
    """The outcome of one check: what was looked at, whether it is well, what was found, how to mend it."""

    subject: str
    well: bool
    found: str
    remedy: str = ""


@dataclass(frozen=True, slots=True)
class Package:
    """A package that a role imports; `probe` is Python that prints its version, or fails if it is of no use."""

    module: str
    probe: str = ""


PACKAGES: dict[str, tuple[Package, ...]] = {
    "learner": (Package("numpy"), Package("numba")),
    "rpc": (
        Package("zenoh", "from importlib.metadata import version; print(version('eclipse-zenoh'))"),
        Package("google.protobuf"),
        Package("pydantic"),
        Package("pydantic_settings"),
        Package("structlog"),
    ),
    "robot": (
        Package(
            "pybullet",
            "import pybullet as b\n"
            "if not b.isNumpyEnabled(): raise SystemExit('built without numpy: pictures would be tuples')\n"
            "from importlib.metadata import version; print(version('pybullet'))",
        ),
    ),
    "camera": (Package("cv2", "import cv2; cv2.aruco.ArucoDetector; cv2.calibrateHandEye; print(cv2.__version__)"),),
    "server": (Package("fastapi"), Package("uvicorn")),
    "client": (Package("httpx2"),),
    "all": (Package("jinja2"),),
}
"""Extra → the packages that it adds; `learner` is the bare install."""


def register(app: typer.Typer) -> None:
    """Adds the verb `doctor`."""

    @app.command("doctor")
    def doctor(
        extra: Annotated[
            list[str] | None, typer.Argument(help=f"Look at these only: {', '.join(PACKAGES)} (default: all).")
        ] = None,
        state_dir: Annotated[Path | None, typer.Option(help="The state directory to check.")] = None,
    ) -> None:
        """Say what is missing on this machine and how to mend it."""
        unknown = sorted(set(extra or ()) - set(PACKAGES))
        if unknown:
            raise typer.BadParameter(f"unknown: {', '.join(unknown)}; known: {', '.join(PACKAGES)}")
        console = Console()
        with console.status("looking"):
            findings = examine(extra or list(PACKAGES), state_dir or state.default_state_dir())
        console.print(_table(findings))
        sick = [finding for finding in findings if not finding.well]
        if sick:
            for finding in sick:
                console.print(f"[red]✗[/] {escape(finding.subject)}: {escape(finding.remedy)}", highlight=False)
            raise typer.Exit(1)
        console.print("[green]All is well.[/]")


def examine(extras: Iterable[str], state_dir: Path) -> list[Finding]:
    """All findings for `extras` (keys of `PACKAGES`) on this machine."""
    extras = list(extras)
    simulation = "robot" in extras or "camera" in extras
    checks: list[Callable[[], Finding]] = [
        lambda: check_python(sys.version_info[:2], simulation=simulation),
        check_platform,
        lambda: check_writable("state directory", state_dir, "give --state-dir or set XDG_STATE_HOME"),
        lambda: check_writable("numba cache", numba_cache(), "set NUMBA_CACHE_DIR to a directory you may write to"),
        check_ports,
    ]
    packages = [(extra, package) for extra in extras for package in PACKAGES[extra]]
    # Each import runs in a process of its own: one that crashes spoils no other, and PyBullet prints on stdout.
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        probed = pool.map(lambda each: check_package(*each), packages)
        return [check() for check in checks] + list(probed)


def check_python(version: tuple[int, int], *, simulation: bool) -> Finding:
    """Python ≥ 3.11; exactly 3.11 for the simulator, whose wheels exist for no later one."""
    found = ".".join(map(str, version))
    if version < (3, 11):
        return Finding("Python", False, found, "install CPython 3.11 and make a new environment with it")
    if simulation and version != (3, 11):
        remedy = "the simulator's wheels exist for CPython 3.11 only: make an environment with it, or build pybullet"
        return Finding("Python", False, found, remedy)
    return Finding("Python", True, f"{found} ({sys.executable})")


def check_platform() -> Finding:
    """Linux on x86-64 is what is tested; anything else is said, not refused."""
    found = f"{platform.system()} {platform.machine()}"
    tested = (platform.system(), platform.machine()) == ("Linux", "x86_64")
    return Finding("platform", True, found if tested else f"{found} (tested: Linux x86_64)")


def check_writable(subject: str, directory: Path, remedy: str) -> Finding:
    """Files can be made in `directory`, or it can be made where it is not yet."""
    nearest = next(each for each in (directory, *directory.absolute().parents) if each.exists())
    if not nearest.is_dir():
        return Finding(subject, False, f"{directory}: {nearest} is not a directory", remedy)
    if not os.access(nearest, os.W_OK | os.X_OK):
        return Finding(subject, False, f"{directory}: {nearest} may not be written", remedy)
    return Finding(subject, True, str(directory))


def numba_cache() -> Path:
    """Where numba may keep its compiled kernels: `NUMBA_CACHE_DIR`, else the user's cache directory."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "numba"


def check_ports() -> Finding:
    """The loopback interface gives the three ports that a stack needs."""
    try:
        ports = free_ports(3)
    except OSError as error:
        remedy = "bring the loopback interface up (`ip link set lo up`) or end programs that hold all ports"
        return Finding("loopback ports", False, str(error), remedy)
    return Finding("loopback ports", True, f"free, for instance {', '.join(map(str, ports))}")


def check_package(extra: str, package: Package) -> Finding:
    """The package imports and is of use."""
    subject = f"{package.module} ({extra})"
    target = "handeye" if extra == "learner" else f"handeye[{extra}]"
    remedy = f"pip install '{target}'"
    probe = package.probe or f"import {package.module} as m; print(m.__version__)"
    try:
        done = subprocess.run(
            [sys.executable, "-c", probe], capture_output=True, text=True, timeout=PROBE_TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired:
        return Finding(subject, False, f"no import within {PROBE_TIMEOUT:g} s", remedy)
    output = done.stdout if done.returncode == 0 else done.stderr
    last = (output.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    return Finding(subject, done.returncode == 0, last, "" if done.returncode == 0 else remedy)


def _table(findings: list[Finding]) -> Table:
    table = Table(box=None, pad_edge=False)
    for title in ("", "checked", "found"):
        table.add_column(title)
    for finding in findings:
        table.add_row("[green]✓[/]" if finding.well else "[red]✗[/]", escape(finding.subject), escape(finding.found))
    return table
