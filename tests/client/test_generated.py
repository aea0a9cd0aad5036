"""The synchronous client is what the asynchronous one makes, and importing it needs little."""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import handeye.client
from handeye.client import AsyncClient, AsyncControl, Client, Control

ROOT = Path(__file__).parents[2]
CLIENT = ROOT / "client" / "handeye" / "client"


def test_the_synchronous_client_is_current(tmp_path: Path) -> None:
    made = tmp_path / "_sync"
    subprocess.run([sys.executable, ROOT / "tools" / "make_sync.py", made], check=True, timeout=60)
    committed = {path.name: path.read_text() for path in (CLIENT / "_sync").glob("*.py")}
    assert {path.name: path.read_text() for path in made.glob("*.py")} == committed, "run `make sync`"


@pytest.mark.parametrize(("slow", "quick"), [(AsyncClient, Client), (AsyncControl, Control)])
def test_both_have_the_same_methods(slow: type, quick: type) -> None:
    def methods(kind: type) -> dict[str, list[str]]:
        return {
            name.replace("aclose", "close"): list(inspect.signature(method).parameters)
            for name, method in inspect.getmembers(kind, callable)
            if not name.startswith("_")
        }

    assert methods(slow) == methods(quick)
    assert len(methods(quick)) > 8


def test_every_public_method_has_a_docstring() -> None:
    for kind in (AsyncClient, AsyncControl, Client, Control):
        assert not [
            name for name, method in inspect.getmembers(kind, callable) if name[0] != "_" and not method.__doc__
        ]


def test_the_exported_names_exist() -> None:
    for module in (handeye.client, handeye.client.models):
        assert sorted(module.__all__) == sorted(set(module.__all__))
        assert not [name for name in module.__all__ if not hasattr(module, name)]


def test_the_error_tree_has_one_root() -> None:
    errors = [
        value for value in vars(handeye.client).values() if isinstance(value, type) and issubclass(value, Exception)
    ]
    assert len(errors) > 8
    assert all(issubclass(error, handeye.client.HandeyeError) for error in errors)


def test_importing_it_needs_an_http_library_pydantic_and_numpy_only() -> None:
    code = "import sys; before = set(sys.modules); import handeye.client, handeye.client.connection; " + (
        "print(*sorted({name.split('.')[0] for name in set(sys.modules) - before} - set(sys.stdlib_module_names)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    found = {name for name in done.stdout.split() if not name.startswith("_")}
    theirs = {"idna", "typing_extensions", "annotated_types", "pydantic_core", "typing_inspection"}
    assert found - theirs == {"handeye", "httpx2", "pydantic", "numpy"}


def test_it_works_without_the_command_lines_packages() -> None:
    code = """
import sys
for name in ("typer", "rich", "click", "numba", "zenoh", "fastapi", "sqlalchemy", "handeye.cli", "structlog"):
    sys.modules[name] = None
import httpx2
from handeye.client import Client
with Client("http://c", transport=httpx2.MockTransport(lambda _: httpx2.Response(200, json={"objects": []}))) as client:
    assert client.objects() == ()
"""
    subprocess.run([sys.executable, "-W", "error", "-c", code], timeout=60, check=True)
