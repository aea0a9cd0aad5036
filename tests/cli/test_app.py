"""Verbs by entry point, stubs for what is not installed, errors as one line."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.metadata import EntryPoint, version

import pytest
import typer
from typer.testing import CliRunner

from handeye.cli import CliError
from handeye.cli.app import KNOWN, OWN_VERBS, build_app, explain, needed, run


def register_greeting(app: typer.Typer) -> None:
    @app.command("greet")
    def greet() -> None:
        """Say hello."""
        typer.echo("hello")


def role(name: str, value: str) -> EntryPoint:
    return EntryPoint(name, value, "handeye.verbs")


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setitem(sys.modules, "roles_of_the_test", sys.modules[__name__])
    return "roles_of_the_test:register_greeting"


def test_a_role_registers_its_verbs(here: str) -> None:
    result = CliRunner().invoke(build_app([role("anything", here)]), ["greet"])
    assert (result.exit_code, result.output) == (0, "hello\n")


def test_a_verb_whose_role_is_absent_names_the_extra() -> None:
    app = build_app([role("robot", "package_that_is_not_there:register")])
    result = CliRunner().invoke(app, ["robot-bridge", "--watch-parent"])
    assert result.exit_code == 1
    assert "pip install 'handeye[robot]'" in result.stderr
    assert "package_that_is_not_there" in result.stderr


def test_help_shows_which_extra_a_stub_needs() -> None:
    app = build_app([role("camera", "package_that_is_not_there:register")])
    assert "handeye[camera]" in CliRunner().invoke(app, ["--help"]).output


def test_an_unknown_absent_role_adds_nothing() -> None:
    app = build_app([role("stranger", "package_that_is_not_there:register")])
    assert CliRunner().invoke(app, ["stranger"]).exit_code == 2


def test_a_missing_package_that_shows_only_when_the_verb_runs_names_the_extra() -> None:
    message = explain(ModuleNotFoundError("No module named 'pybullet'", name="pybullet"), ["robot-bridge"])
    assert message is not None
    assert "'pybullet'" in message
    assert "handeye[robot]" in message


def test_a_missing_module_of_our_own_is_a_bug() -> None:
    error = ModuleNotFoundError("No module named 'handeye.robot_bridge.gone'", name="handeye.robot_bridge.gone")
    assert explain(error, ["robot-bridge"]) is None


def test_errors_of_the_project_are_one_line_and_others_are_bugs() -> None:
    assert explain(CliError("the robot is gone"), []) == "the robot is gone"
    assert explain(ZeroDivisionError("division by zero"), []) is None


def test_wrong_settings_are_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    pydantic = pytest.importorskip("pydantic")

    class Settings(pydantic.BaseModel):  # type: ignore[misc, name-defined]
        port: int

    with pytest.raises(pydantic.ValidationError) as caught:
        Settings(port="many")
    message = explain(caught.value, [])
    assert message is not None
    assert "port" in message
    assert "\n" not in message


def test_run_returns_the_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == f"handeye {version('handeye')}\n"
    assert run(["no-such-verb"]) == 2


@pytest.mark.parametrize(
    ("arguments", "roles"),
    [
        (["robot-bridge", "--watch-parent"], {"robot"}),
        (["demo"], {"simulation"}),
        (["up"], set()),
        ([], set(KNOWN)),
        (["--url", "http://here:1", "--token", "run", "query", "m"], {"client"}),
        (["--url=http://here:1", "demo"], {"simulation"}),
        (["--url", "http://here:1"], set(KNOWN)),
    ],
)
def test_only_the_role_of_the_verb_is_loaded(arguments: list[str], roles: set[str]) -> None:
    assert {role.name for role in needed(arguments)} == roles


def test_help_needs_all_roles() -> None:
    assert {role.name for role in needed(["--help"])} == set(KNOWN)


def test_the_known_verbs_are_those_that_the_roles_register() -> None:
    app = build_app()
    names = {command.name or getattr(command.callback, "__name__", "") for command in app.registered_commands}
    names |= {group.name for group in app.registered_groups}
    assert names == {*OWN_VERBS, *(verb for role in KNOWN.values() for verb in role.verbs)}


def test_every_known_role_is_an_entry_point_of_the_distribution() -> None:
    from importlib.metadata import entry_points

    assert set(KNOWN) == {role.name for role in entry_points(group="handeye.verbs")}


def test_where_the_coordinator_is_may_be_said_before_the_verb(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("HANDEYE_URL", "HANDEYE_TOKEN"):
        monkeypatch.setenv(name, "set by the test")  # so that what the command sets is undone
    assert run(["--url", "http://127.0.0.1:9", "--token", "secret", "stop"]) == 1
    assert "The coordinator at http://127.0.0.1:9 cannot be reached" in capsys.readouterr().err
    assert (os.environ["HANDEYE_URL"], os.environ["HANDEYE_TOKEN"]) == ("http://127.0.0.1:9", "secret")


def test_the_missing_package_of_a_verb_behind_options_names_the_extra() -> None:
    message = explain(ModuleNotFoundError("No module named 'fastapi'", name="fastapi"), ["--url", "x", "server"])
    assert message is not None
    assert "`handeye server`" in message


def test_without_typer_the_command_says_what_to_install() -> None:
    code = "import sys; sys.modules['typer'] = None; from handeye.cli.main import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=30, check=False, env=dict(os.environ)
    )
    assert done.returncode == 1
    assert "pip install 'handeye[cli]'" in done.stderr
    assert "Traceback" not in done.stderr
