"""The whole application's routes: what each needs, and that it says so."""

from __future__ import annotations

from typing import Any, cast

import pytest
from fastapi.routing import APIRoute, iter_route_contexts

from handeye.server.access import Access, Role
from handeye.server.access.roles import OPEN_PATHS
from handeye.server.app import create_app
from handeye.server.coordinator import Coordinator
from handeye.server.store import Store
from tests.server.access.conftest import Site, sentence

ADMIN = {
    ("get", "/v1/tokens"),
    ("post", "/v1/tokens"),
    ("delete", "/v1/tokens/{token_id}"),
    ("get", "/v1/backup"),
    ("post", "/v1/restore"),
}
VIEWERS_WRITES = {("post", "/v1/modules/{module}/query"), ("post", "/v1/robot/stop")}


@pytest.fixture
def site(store: Store) -> Site:
    site = Site(store)
    nobody = cast(Coordinator, None)  # no request comes so far
    site.app = create_app(nobody, Access(site.tokens, site.limits, site.metrics))
    return site


@pytest.fixture
def operations(site: Site) -> dict[tuple[str, str], dict[str, Any]]:
    paths = site.app.openapi()["paths"]
    return {(method, path): operation for path, methods in paths.items() for method, operation in methods.items()}


def test_each_operation_needs_what_was_agreed(operations: dict[tuple[str, str], dict[str, Any]]) -> None:
    assert len(operations) > 50
    assert set(operations) >= VIEWERS_WRITES
    for (method, path), operation in operations.items():
        if path in OPEN_PATHS:
            assert operation["security"] == []
        elif (method, path) in ADMIN:
            assert operation["x-role"] == "admin"
        elif method == "get" or (method, path) in VIEWERS_WRITES:
            assert operation["x-role"] == "viewer", (method, path)
        else:
            assert operation["x-role"] == "operator", (method, path)


def test_each_refusal_is_held_up_by_the_gate(site: Site, operations: dict[tuple[str, str], dict[str, Any]]) -> None:
    """For every operation: a token of the role below is refused before the route is asked anything."""
    below = {"operator": site.client(site.secret(Role.VIEWER)), "admin": site.client(site.secret(Role.OPERATOR))}
    anybody = site.client(None)
    for (method, path), operation in operations.items():
        if path in OPEN_PATHS:
            continue
        sentence(anybody.request(method, path), 401, "token_missing")
        if (role := operation["x-role"]) in below:
            told = sentence(below[role].request(method, path), 403, "forbidden")
            assert told.startswith(f"This needs the role {role}, ")


def test_no_route_is_hidden_from_the_schema(site: Site, operations: dict[tuple[str, str], dict[str, Any]]) -> None:
    hidden = [
        context.path
        for context in iter_route_contexts(site.app.routes)
        if isinstance(context.original_route, APIRoute)
        for method in context.methods or ()
        if (method.lower(), context.path) not in operations
    ]
    assert hidden == []


def test_each_operation_declares_what_each_can_give(operations: dict[tuple[str, str], dict[str, Any]]) -> None:
    everywhere = {"400", "401", "403", "413", "415", "422", "429", "431", "500"}
    lacking = {
        operation: everywhere - set(declared["responses"])
        for operation, declared in operations.items()
        if operation[1] not in OPEN_PATHS and not everywhere <= set(declared["responses"])
    }
    assert lacking == {}
