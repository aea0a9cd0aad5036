from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from handeye.cli.app import build_app, run
from handeye.server.store import Store
from handeye.server.store.tables import samples
from tests.server.store.example import fill


@pytest.fixture
def damaged(sqlite_url: str) -> str:
    """A store in which a byte of a sample has changed."""
    with Store.open(sqlite_url) as store:
        fill(store)
        with store.read() as connection:
            row = connection.execute(samples.select().where(samples.c.number == 20)).mappings().first()
    assert row is not None
    path = Path(sqlite_url.removeprefix("sqlite:///"))
    content = bytearray(path.read_bytes())
    content[content.index(row["output"])] ^= 1
    path.write_bytes(content)
    return sqlite_url


class TestVerbs:
    def test_verify_then_repair_then_verify(self, damaged: str) -> None:
        invoke = CliRunner().invoke
        found = invoke(build_app(), ["verify", "--database-url", damaged])
        assert found.exit_code == 1
        assert "samples\tfree/20\tits checksum does not fit" in found.stdout
        mended = invoke(build_app(), ["repair"], env={"HANDEYE_DATABASE_URL": damaged})
        assert mended.exit_code == 0, mended.output
        assert "one byte of it had changed\tit was put right" in mended.stdout
        assert "The damaged file is kept as" in mended.stdout
        for verb in ("verify", "repair"):
            well = invoke(build_app(), [verb, "--database-url", damaged])
            assert well.exit_code == 0, well.output
            assert "The store is well" in well.stdout

    def test_by_default_they_look_where_the_server_does(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.delenv("HANDEYE_DATABASE_URL", raising=False)
        monkeypatch.setenv("HANDEYE_SERVER_DATA_DIR", str(tmp_path))
        for verb in ("verify", "repair"):
            assert run([verb]) == 1
            assert f"there is no store {tmp_path / 'handeye.db'}" in capsys.readouterr().err
        assert not list(tmp_path.iterdir())
        Store.open(f"sqlite:///{tmp_path / 'handeye.db'}").close()
        assert run(["verify"]) == 0

    def test_repair_waits_for_the_server_to_end(self, sqlite_url: str, capsys: pytest.CaptureFixture[str]) -> None:
        with Store.open(sqlite_url):
            assert run(["repair", "--database-url", sqlite_url]) == 1
        assert "end that one first" in capsys.readouterr().err
