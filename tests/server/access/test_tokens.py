"""Tokens: made, used, expired, revoked; and the first one."""

from __future__ import annotations

import stat
import sys
import threading
import time
from pathlib import Path

import pytest
from fastapi import Request
from pydantic import SecretStr
from sqlalchemy import select, update

from handeye.server.access import Role, Tokens, show_first_token
from handeye.server.problem import Conflict, NotFound
from handeye.server.store import Store, tables
from tests.server.access.conftest import ADMIN, Site, sentence


def test_nothing_but_health_answers_without_a_token(site: Site) -> None:
    http = site.client(None)
    assert http.get("/healthz").status_code == 200
    for method, path in [("GET", "/v1/things/cup"), ("GET", "/nowhere"), ("POST", "/v1/things"), ("TRACE", "/metrics")]:
        response = http.request(method, path)
        assert "Authorization: Bearer <token>" in sentence(response, 401, "token_missing")
        assert response.headers["www-authenticate"] == "Bearer"


@pytest.mark.parametrize("given", [f"Basic {ADMIN}", "Bearer", "Bearer ", ADMIN, "", "Bearer\t" + ADMIN])
def test_what_is_no_bearer_token(site: Site, given: str) -> None:
    response = site.client(None).get("/v1/things/cup", headers={"Authorization": given})
    sentence(response, 401, "token_missing")


@pytest.mark.parametrize("given", [f"{ADMIN}x", "guessed", "\u00e9", f"{ADMIN} {ADMIN}", "x" * 10_000])
def test_a_wrong_token_is_refused_and_not_repeated(site: Site, given: str) -> None:
    response = site.client(None).get("/v1/things/cup", headers={b"Authorization": f"Bearer {given}".encode("latin-1")})
    assert "POST /v1/tokens" in sentence(response, 401, "token_wrong")
    assert given not in response.text
    assert ADMIN not in response.text


def test_the_scheme_is_case_insensitive(site: Site) -> None:
    response = site.client(None).get("/v1/things/cup", headers={"Authorization": f"bEARER  {ADMIN} "})
    assert response.status_code == 200


def test_an_expired_token_says_since_when(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    http = site.client(site.secret(Role.VIEWER, days=1.0))
    assert http.get("/v1/things/cup").status_code == 200
    tomorrow = time.time() + 86401.0
    monkeypatch.setattr(time, "time", lambda: tomorrow)
    assert "expired at 20" in sentence(http.get("/v1/things/cup"), 401, "token_expired")


def test_a_revoked_token_is_wrong_at_once(site: Site) -> None:
    token, secret = site.tokens.create("guest", Role.VIEWER, None)
    http = site.client(secret)
    assert http.get("/v1/things/cup").status_code == 200
    site.tokens.revoke(token.id)
    sentence(http.get("/v1/things/cup"), 401, "token_wrong")
    with pytest.raises(NotFound, match=token.id):
        site.tokens.revoke(token.id)


def test_routes_know_who_asks(site: Site) -> None:
    @site.app.get("/v1/me")
    def me(request: Request) -> str:
        return str(request.state.token.id)

    token, secret = site.tokens.create("lab", Role.VIEWER, None)
    assert site.client(secret).get("/v1/me").json() == token.id
    assert site.client().get("/v1/me").json() == "configured"


def test_no_request_asks_the_store(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    http = site.client(site.secret(Role.VIEWER))
    monkeypatch.setattr(Store, "read", lambda _store: pytest.fail("asked"))
    assert http.get("/v1/things/cup").status_code == 200


def test_tokens_outlive_a_restart_and_the_secret_is_nowhere(site: Site, tmp_path: Path) -> None:
    token, secret = site.tokens.create("lab", Role.OPERATOR, 30.0)
    again = Tokens(site.store)
    found = again.find(secret.encode())
    assert found is not None
    assert (found.id, found.name, found.role, found.created) == (token.id, "lab", Role.OPERATOR, token.created)
    assert found.expires == pytest.approx(time.time() + 30 * 86400, abs=60)
    assert [each.id for each in again.all()] == [token.id]
    for file in tmp_path.iterdir():
        assert secret.encode() not in file.read_bytes()


def test_the_configured_token_is_an_admin_and_in_no_store(site: Site, store: Store) -> None:
    found = site.tokens.find(ADMIN.encode())
    assert found is not None
    assert (found.name, found.role, found.valid()) == ("configured", Role.ADMIN, True)
    assert site.tokens.all() == []
    assert Tokens(store).find(ADMIN.encode()) is None
    with store.read() as connection:
        assert connection.execute(select(tables.tokens)).all() == []


@pytest.mark.parametrize("useless", ["", " ", "two words", "ümlaut", "line\nbreak"])
def test_a_token_that_no_header_can_carry(store: Store, useless: str) -> None:
    with pytest.raises(ValueError, match="HANDEYE_SERVER_TOKEN") as refusal:
        Tokens(store, SecretStr(useless))
    assert not useless.strip() or useless not in str(refusal.value)


def test_a_damaged_row_does_not_count(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    viewer, secret = site.tokens.create("lab", Role.VIEWER, None)
    with site.store.write() as connection:
        connection.execute(update(tables.tokens).values(role="admin"))
    site.tokens.reload()
    assert site.tokens.find(secret.encode()) is None
    assert viewer.revoked
    assert "handeye verify" in capsys.readouterr().out


def test_the_last_admin_stays(store: Store) -> None:
    tokens = Tokens(store)
    first, _secret = tokens.create("first", Role.ADMIN, None)
    tokens.create("lab", Role.OPERATOR, None)
    with pytest.raises(Conflict, match="the last token of an admin"):
        tokens.revoke(first.id)
    second, _secret = tokens.create("second", Role.ADMIN, None)
    tokens.revoke(first.id)
    assert second in tokens.all()
    configured = Tokens(store, SecretStr(ADMIN))
    configured.revoke(second.id)


def test_many_threads_make_and_revoke(store: Store) -> None:
    tokens = Tokens(store, SecretStr(ADMIN))

    def work() -> None:
        for _ in range(5):
            token, secret = tokens.create("guest", Role.VIEWER, None)
            assert tokens.find(secret.encode()) is token
            tokens.revoke(token.id)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert tokens.all() == Tokens(store).all() == []


# The first token


def test_the_first_token_goes_to_a_terminal(store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    told: list[str] = []
    tokens = Tokens(store)
    tokens.ensure_admin(lambda secret: show_first_token(secret, tmp_path, told.append))
    found = tokens.find(told[0].rsplit(maxsplit=1)[1].encode())
    assert found is not None
    assert found.role is Role.ADMIN
    assert not (tmp_path / "first-token").exists()
    tokens.ensure_admin(lambda _secret: pytest.fail("there is one"))


def test_elsewhere_it_goes_to_a_file_that_only_its_owner_reads(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: False)
    path = tmp_path / "first-token"
    path.write_text("of another life")
    path.chmod(0o666)
    told: list[str] = []
    tokens = Tokens(store)
    tokens.ensure_admin(lambda secret: show_first_token(secret, tmp_path, told.append))
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    secret = path.read_text().strip()
    assert tokens.find(secret.encode()) is not None
    assert str(path) in told[0]
    assert secret not in told[0]
    assert [file.name for file in tmp_path.glob(".first-token-*")] == []


def test_a_token_that_could_not_be_shown_is_none(store: Store, tmp_path: Path) -> None:
    tokens = Tokens(store)
    with pytest.raises(OSError, match="nowhere"):
        tokens.ensure_admin(lambda secret: show_first_token(secret, tmp_path / "nowhere", print))
    assert tokens.all() == Tokens(store).all() == []


def test_no_first_token_where_one_is_configured(store: Store) -> None:
    Tokens(store, SecretStr(ADMIN)).ensure_admin(lambda _secret: pytest.fail("not needed"))


def test_a_new_first_token_when_no_admin_could_come_in(store: Store) -> None:
    tokens = Tokens(store)
    tokens.create("lab", Role.OPERATOR, None)
    tokens.create("former", Role.ADMIN, 1e-9)
    shown: list[str] = []
    tokens.ensure_admin(shown.append)
    assert len(shown) == 1
