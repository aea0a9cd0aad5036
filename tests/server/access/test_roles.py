"""Which role a request needs. What nobody thought of needs more than reading does."""

from __future__ import annotations

import pytest

from handeye.server.access import Role
from handeye.server.access.roles import body_limit, describe, needed_role
from tests.server.access.conftest import Site, sentence


@pytest.mark.parametrize(
    ("method", "path", "role"),
    [
        ("GET", "/healthz", None),
        ("GET", "/readyz", None),
        ("GET", "/readyz/", Role.VIEWER),
        ("GET", "/metrics", Role.VIEWER),
        ("GET", "/v1/openapi.json", Role.VIEWER),
        ("GET", "/v1/modules/ijs/export", Role.VIEWER),
        ("HEAD", "/v1/modules", Role.VIEWER),
        ("POST", "/v1/modules/ijs/query", Role.VIEWER),
        ("POST", "/v1/robot/stop", Role.VIEWER),
        ("POST", "/v1/modules", Role.OPERATOR),
        ("POST", "/v1/modules/query", Role.OPERATOR),
        ("POST", "/v1/modules/a/b/query", Role.OPERATOR),
        ("POST", "/v1/modules/ijs/query/", Role.OPERATOR),
        ("POST", "/v1/modules/ijs/query\n", Role.OPERATOR),
        ("DELETE", "/v1/modules/ijs/query", Role.OPERATOR),
        ("POST", "/v1/robot/stop/", Role.OPERATOR),
        ("POST", "/v1/robot/reset", Role.OPERATOR),
        ("PUT", "/v1/robot/lease", Role.OPERATOR),
        ("PATCH", "/v1/demonstrations/x", Role.OPERATOR),
        ("TRACE", "/v1/modules", Role.OPERATOR),
        ("BREW", "/nowhere", Role.OPERATOR),
        ("GET", "/v1/tokens", Role.ADMIN),
        ("POST", "/v1/tokens", Role.ADMIN),
        ("DELETE", "/v1/tokens/1", Role.ADMIN),
        ("HEAD", "/v1/tokens/\n", Role.ADMIN),
        ("GET", "/v1/backup", Role.ADMIN),
        ("POST", "/v1/restore", Role.ADMIN),
        ("GET", "/v1/tokens-of-others", Role.VIEWER),
    ],
)
def test_what_a_request_needs(method: str, path: str, role: Role | None) -> None:
    assert needed_role(method, path) is role


def test_each_role_may_do_what_those_before_it_may() -> None:
    roles = [Role.VIEWER, Role.OPERATOR, Role.ADMIN]
    for mine in roles:
        assert [mine.covers(needed) for needed in roles] == [roles.index(mine) >= n for n in range(3)]


def test_archives_are_few() -> None:
    assert body_limit("/v1/restore") == body_limit("/v1/modules/import") == "archive_bytes"
    assert body_limit("/v1/modules/import/samples") == body_limit("/v1/modules/CSS/query") == "batch_bytes"
    assert body_limit("/v1/modules") == body_limit("/v1/robot/stop") == "body_bytes"


@pytest.mark.parametrize(
    ("role", "statuses"),
    [(Role.VIEWER, [200, 200, 200, 403, 403]), (Role.OPERATOR, [200, 200, 200, 201, 403]), (Role.ADMIN, [200] * 3)],
)
def test_roles_hold(site: Site, role: Role, statuses: list[int]) -> None:
    http = site.client(site.secret(role))
    asked = [
        http.get("/v1/things/cup"),
        http.post("/v1/modules/ijs/query"),
        http.post("/v1/robot/stop"),
        http.post("/v1/things", json={"name": "cup"}),
        http.post("/v1/restore"),
    ]
    assert [response.status_code for response in asked][: len(statuses)] == statuses
    if role is Role.VIEWER:
        told = sentence(asked[3], 403, "forbidden")
        assert told == "This needs the role operator, the token 'a viewer' has viewer."
    if role is Role.ADMIN:
        assert asked[4].json() == {"bytes": 0}


def test_the_schema_tells_the_roles(site: Site) -> None:
    schema = site.app.openapi()
    describe(schema)
    paths = schema["paths"]
    assert paths["/healthz"]["get"]["security"] == []
    assert "x-role" not in paths["/healthz"]["get"]
    assert paths["/v1/things"]["post"]["x-role"] == "operator"
    assert paths["/v1/restore"]["post"]["x-role"] == "admin"
    assert paths["/v1/modules/{module}/query"]["post"]["x-role"] == "viewer"
