"""The committed OpenAPI document is the one that the server gives, and says what a caller needs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from starlette.testclient import TestClient

from handeye.server.openapi import document
from tests.server.conftest import TOKEN

if TYPE_CHECKING:
    from tests.server.conftest import Lab

COMMITTED = Path(__file__).parents[2] / "docs" / "openapi.json"


def test_the_committed_document_is_current() -> None:
    assert COMMITTED.read_text() == document(), "the routes have changed: run `make openapi`"


def test_a_running_server_gives_it_too(lab: Lab) -> None:
    with TestClient(lab.app(), headers={"Authorization": f"Bearer {TOKEN}"}) as http:
        assert http.get("/v1/openapi.json").json() == json.loads(COMMITTED.read_text())


def test_every_operation_is_described_and_says_how_it_is_refused() -> None:
    for path, operations in json.loads(COMMITTED.read_text())["paths"].items():
        for method, operation in operations.items():
            where = f"{method} {path}"
            assert operation["summary"], where
            assert operation["description"], where
            assert operation["tags"], where
            if path.startswith("/v1"):
                assert operation["x-role"] in ("viewer", "operator", "admin"), where
                assert {"401", "403", "429"} <= set(operation["responses"]), where
                for status, response in operation["responses"].items():
                    if status[0] in "45":
                        assert "application/problem+json" in response["content"], where


def test_calls_have_names_and_those_that_make_something_take_a_key() -> None:
    names = []
    for path, operations in json.loads(COMMITTED.read_text())["paths"].items():
        for method, operation in operations.items():
            names.append(operation["operationId"])
            parameters = {parameter["name"]: parameter for parameter in operation.get("parameters", ())}
            if method == "post" and {"201", "202"} & set(operation["responses"]):
                # A secret is not kept to be told again, and to cancel twice is to cancel.
                keyless = operation["operationId"] in ("make_token", "take_control", "cancel_job")
                assert ("Idempotency-Key" in parameters) is not keyless, path
            for name in ("Idempotency-Key", "Control-Lease", "Last-Event-ID", "limit", "cursor"):
                assert parameters.get(name, {"description": "none"})["description"], path
            if "Idempotency-Key" in parameters:
                assert "409" in operation["responses"], path
    assert len(names) == len(set(names))
    assert all(name.isidentifier() and "v1" not in name for name in names)
