"""The state directory: private files, one owner at a time."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from handeye.cli import state
from handeye.cli.errors import AlreadyRunning, CliError


def test_private_files_are_for_their_owner_only_and_replace_older_ones(tmp_path: Path) -> None:
    path = tmp_path / "handeye.json"
    path.write_text("old")
    path.chmod(0o644)
    state.write_private(path, {"url": "http://127.0.0.1:1", "token": "secret"})
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert state.read_private(path) == {"url": "http://127.0.0.1:1", "token": "secret"}
    assert [entry.name for entry in tmp_path.iterdir()] == ["handeye.json"]


@pytest.mark.parametrize("content", [None, "no json", "[1]"])
def test_a_missing_or_broken_file_says_what_to_do(tmp_path: Path, content: str | None) -> None:
    path = tmp_path / "handeye.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(CliError, match="handeye up"):
        state.read_private(path)


def test_one_stack_to_a_state_directory(tmp_path: Path) -> None:
    first, second = state.exclusive(tmp_path / "state"), state.exclusive(tmp_path / "state")
    with first, pytest.raises(AlreadyRunning, match="in use by process"), second:
        pass
    with state.exclusive(tmp_path / "state"):
        pass


def test_the_default_follows_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert state.default_state_dir() == tmp_path / "handeye"


def test_the_client_finds_the_stack_of_the_default_state_directory(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    connection = pytest.importorskip("handeye.client.connection")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.delenv("HANDEYE_URL", raising=False)
    monkeypatch.delenv("HANDEYE_TOKEN", raising=False)
    state.default_state_dir().mkdir()
    state.write_private(state.default_state_dir() / state.SERVER_FILE, {"url": "http://127.0.0.1:1", "token": "t"})
    assert tuple(connection.find()) == ("http://127.0.0.1:1", "t")
