"""What can be said of the containers' files without Docker."""

from __future__ import annotations

import json
import os
import re
import stat
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCKERFILES = [ROOT / role / "Dockerfile" for role in ("robot_bridge", "camera_bridge", "server")]


def locked(name: str) -> dict[str, str]:
    """The packages of a lock file with their versions and hashes."""
    blocks = re.split(r"^(?=[\w.\[\]-]+==)", (ROOT / name).read_text(), flags=re.MULTILINE)[1:]
    return {block.split("==")[0]: " ".join(re.findall(r"==\S+|sha256:\S+", block)) for block in blocks}


@pytest.mark.parametrize("name", ["requirements-bridge.txt", "requirements-server.txt"])
def test_the_images_take_their_packages_from_the_lock(name: str) -> None:
    packages, all_packages = locked(name), locked("requirements.txt")
    assert packages
    assert packages == {package: all_packages.get(package) for package in packages}, "run `make lock`"


@pytest.mark.parametrize("path", DOCKERFILES, ids=lambda path: path.parent.name)
def test_the_dockerfiles(path: Path) -> None:
    lines = path.read_text().splitlines()
    assert "ARG PYTHON_IMAGE=python:3.11-slim-bookworm" in lines
    assert [line for line in lines if line.startswith("FROM")] == ["FROM ${PYTHON_IMAGE}"]
    assert any("--require-hashes" in line for line in lines)
    assert "USER 10001:10001" in lines
    assert not any(re.search(r"# *syntax=|@sha256:|://", line) for line in lines)


def make_credentials(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / "tools" / "make-credentials"), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)


def contents(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


def test_credentials_are_made_once(tmp_path: Path) -> None:
    folders = {kind: tmp_path / kind for kind in ("acting", "lab", "database")}
    for folder in folders.values():
        folder.mkdir()
    wanted = [f"{kind}={folder}" for kind, folder in folders.items()]
    assert make_credentials(*wanted).returncode == 0
    made = {kind: contents(folder) for kind, folder in folders.items()}
    again = make_credentials(*wanted)
    assert (again.returncode, again.stderr) == (0, "")
    assert {kind: contents(folder) for kind, folder in folders.items()} == made

    acting, lab, database = made.values()
    passwords = {acting["handeye_bus_password"], lab["handeye_lab_bus_password"], database["password"]}
    assert len(passwords) == 3
    assert min(map(len, passwords)) >= 32
    admitted = json.loads(acting["handeye_router_credentials"])
    assert admitted == {acting["handeye_bus_user"]: acting["handeye_bus_password"]}
    assert database["handeye_database_url"].endswith(f":{database['password']}@postgres/handeye")
    for path in (path for folder in folders.values() for path in folder.iterdir()):
        assert stat.S_IMODE(path.stat().st_mode) == (0o444 if path.name == "password" else 0o600), path
    # What is missing is made anew, to go with what is there.
    (folders["acting"] / "handeye_router_credentials").unlink()
    assert make_credentials(wanted[0]).returncode == 0
    assert contents(folders["acting"]) == acting


@pytest.mark.parametrize("arguments", [(), ("acting",), ("acting=",), ("truth=/tmp",)])
def test_wrong_arguments_are_explained(arguments: tuple[str, ...]) -> None:
    ended = make_credentials(*arguments)
    assert ended.returncode == 1
    assert "Usage: make-credentials" in ended.stderr


def test_processes_read_them(tmp_path: Path) -> None:
    for kind in ("acting", "lab", "database"):
        (tmp_path / kind).mkdir()
        assert make_credentials(f"{kind}={tmp_path / kind}").returncode == 0
    program = (
        "from handeye.rpc import BusSettings, LabBusSettings\n"
        "from handeye.rpc.settings import RouterSettings\n"
        "from handeye.server.settings import StoreSettings\n"
        "acting, lab, router = BusSettings(), LabBusSettings(), RouterSettings()\n"
        "print(lab.user, lab.password.get_secret_value())\n"
        "print(router.credentials[acting.user] == acting.password)\n"
        "print(acting.endpoint, acting.password)\n"
        "print(StoreSettings().database_url.get_secret_value())\n"
    )
    environment = {
        **{key: value for key, value in os.environ.items() if not key.startswith("HANDEYE_")},
        "HANDEYE_SECRETS_DIR": ":".join(str(tmp_path / kind) for kind in ("acting", "lab", "database")),
        "HANDEYE_BUS_ENDPOINT": "tcp/127.0.0.1:1",
    }
    ended = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=30, check=False
    )
    password = (tmp_path / "lab" / "handeye_lab_bus_password").read_text()
    url = (tmp_path / "database" / "handeye_database_url").read_text()
    assert ended.stdout == f"lab {password}\nTrue\ntcp/127.0.0.1:1 **********\n{url}\n", ended.stderr
