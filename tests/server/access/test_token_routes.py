"""Tokens over REST, and what Prometheus and health checks read."""

from __future__ import annotations

import time
from datetime import datetime
from types import SimpleNamespace

import pytest
from fastapi import FastAPI
from prometheus_client.parser import text_string_to_metric_families
from starlette.testclient import TestClient

from handeye.server import problem_responses
from handeye.server.access import Access, Role
from handeye.server.routes import Lanes, health, tokens
from handeye.server.store import Store
from tests.server.access.conftest import Site, sentence


@pytest.fixture
def site(store: Store) -> Site:
    site = Site(store)
    app = FastAPI()
    problem_responses.install(app)
    Access(site.tokens, site.limits, site.metrics).install(app)
    app.include_router(health.router)
    app.include_router(tokens.router)
    app.state.coordinator = SimpleNamespace(missing=list)
    app.state.lanes = Lanes()
    site.app = app
    return site


def test_a_token_is_made_used_listed_and_revoked(site: Site, http: TestClient) -> None:
    made = http.post("/v1/tokens", json={"name": "lab", "role": "viewer", "days": 30})
    assert made.status_code == 201
    token = made.json()
    secret = token.pop("token")
    assert (token["name"], token["role"]) == ("lab", "viewer")
    created, expires = (datetime.fromisoformat(token[key]) for key in ("created", "expires"))
    assert (expires - created).total_seconds() == pytest.approx(30 * 86400)
    assert created.timestamp() == pytest.approx(time.time(), abs=60)

    assert http.get("/v1/tokens").json() == {"tokens": [token]}
    guest = site.client(secret)
    assert guest.get("/metrics").status_code == 200
    for response in (
        guest.get("/v1/tokens"),
        guest.post("/v1/tokens", json={"name": "me", "role": "admin", "days": None}),
        guest.delete(f"/v1/tokens/{token['id']}"),
    ):
        assert sentence(response, 403, "forbidden") == "This needs the role admin, the token 'lab' has viewer."

    assert http.delete(f"/v1/tokens/{token['id']}").status_code == 204
    sentence(guest.get("/metrics"), 401, "token_wrong")
    sentence(http.delete(f"/v1/tokens/{token['id']}"), 404, "not_found")
    assert http.get("/v1/tokens").json() == {"tokens": []}


def test_a_token_without_an_end(http: TestClient) -> None:
    made = http.post("/v1/tokens", json={"name": "lab", "role": "operator", "days": None}).json()
    assert made["expires"] is None


@pytest.mark.parametrize(
    ("body", "wrong"),
    [
        ({"name": "lab", "role": "viewer"}, "body.days"),
        ({"name": "lab", "role": "owner", "days": 1}, "body.role"),
        ({"name": "", "role": "viewer", "days": 1}, "body.name"),
        ({"name": "a\nb", "role": "viewer", "days": 1}, "body.name"),
        ({"name": "lab", "role": "viewer", "days": 0}, "body.days"),
        ({"name": "lab", "role": "viewer", "days": 1e9}, "body.days"),
        ({"name": "lab", "role": "viewer", "days": 10**400}, "body.days"),
        ({"name": "lab", "role": "viewer", "days": "nan"}, "body.days"),
        ({"name": "lab", "role": "viewer", "days": 1, "token": "mine"}, "body.token"),
    ],
)
def test_wrong_requests_name_the_field(http: TestClient, body: dict[str, object], wrong: str) -> None:
    assert wrong in sentence(http.post("/v1/tokens", json=body), 422, "invalid_argument")


def test_the_last_admin_s_token_stays(store: Store) -> None:
    site = Site(store, configured=None)
    secret = site.secret(Role.ADMIN)
    app = FastAPI()
    problem_responses.install(app)
    Access(site.tokens, site.limits, site.metrics).install(app)
    app.include_router(tokens.router)
    site.app = app
    http = site.client(secret)
    [token] = http.get("/v1/tokens").json()["tokens"]
    assert "last token of an admin" in sentence(http.delete(f"/v1/tokens/{token['id']}"), 409, "conflict")


def test_metrics_are_prometheus_text(site: Site, http: TestClient) -> None:
    http.get("/v1/tokens")
    response = http.get("/metrics")
    assert response.headers["content-type"].startswith("text/plain; version=")
    families = {family.name: family for family in text_string_to_metric_families(response.text)}
    [tokens_read] = [s for s in families["handeye_requests"].samples if s.labels["route"] == "/v1/tokens"]
    assert tokens_read.labels == {"method": "GET", "route": "/v1/tokens", "status": "200"}
    assert tokens_read.value == 1
    sentence(site.client(None).get("/metrics"), 401, "token_missing")


def test_health_needs_no_token(site: Site) -> None:
    http = site.client(None)
    assert http.get("/healthz").json() == http.get("/readyz").json() == {"status": "ok"}
    site.app.state.coordinator.missing = lambda: ["nobody serves Camera on the bus"]
    response = http.get("/readyz")
    assert "nobody serves Camera" in sentence(response, 503, "not_ready")
    assert response.json()["missing"] == ["nobody serves Camera on the bus"]
