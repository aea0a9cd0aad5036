"""Schemathesis over the whole OpenAPI document, against the toy lab behind the real HTTP server.

Examples, boundaries, random and wrong requests, and chains of them: none may bring about what the document does not
say, and none a 500. By default the same few requests each time; more and others when HANDEYE_SCHEMATHESIS_EXAMPLES says
how many of each operation.
"""

from __future__ import annotations

import os
import socket
import threading
from collections import Counter
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import schemathesis
import structlog
from hypothesis import strategies as st
from schemathesis.config import SchemathesisConfig
from schemathesis.engine import events, from_schema

from handeye.server.serve import http_server
from handeye.server.store import replies
from tests.server.conftest import TOKEN, asking
from tests.server.rest import declaration, packed, samples

if TYPE_CHECKING:
    from tests.server.conftest import Lab

EXAMPLES = int(os.environ.get("HANDEYE_SCHEMATHESIS_EXAMPLES", "0"))
"""Of each operation; 0: few, and always the same ones."""

HEADERS = {"Authorization": f"Bearer {TOKEN}"}

# What a schema cannot say, and what is answered then.
NOT_SAID = {
    "a cursor is what a page gave": (["list_modules", "list_samples", "list_demonstrations", "list_jobs"], ["400"]),
    "components have names of their own; a quadratic fit takes few inputs": (
        ["create_module", "train_module"],
        ["422"],
    ),
    "vectors are as long as the module's declaration says": (["add_samples", "query_module"], ["400", "422"]),
    "numbers or a demonstration, not both": (["remove_samples"], ["422"]),
    "a file is an archive of arrays, or a store": (["import_module", "restore_backup"], ["400", "422"]),
    "corners, synergies, targets and the rows of a grid fit each other, and a grid is in view": (
        ["collect_postures", "reach", "collect_grid_view"],
        ["422"],
    ),
    "the kndb2 of a task, too, takes fewer neighbours": (["train_task"], ["422"]),
}
ACCEPTED = ["2xx", "3xx", "401", "403", "404", "409", "429", "5xx"]


def allow(operations: list[str], check: str, **options: Any) -> dict[str, Any]:
    return {"include-operation-id": operations, "checks": {check: options}}


OPERATIONS = [
    *(
        allow(operations, "positive_data_acceptance", **{"expected-statuses": [*ACCEPTED, *refused]})
        for operations, refused in NOT_SAID.values()
    ),
    # A picture of a time that is still to come is waited for, and does not come.
    allow(
        ["camera_frame", "add_background", "add_example", "add_observation", "look", "collect_grid_view"],
        "not_a_server_error",
        **{"expected-statuses": ["2xx", "3xx", "4xx", "504"]},
    ),
    # A module may be called "import": then GET and DELETE are possible at this path, too, as /v1/modules/{module}.
    allow(["import_module"], "allow_header_conformance", enabled=False),
]


def configuration() -> SchemathesisConfig:
    few = {"max-examples": EXAMPLES or 6, "deterministic": not EXAMPLES, "database": "none"}
    return SchemathesisConfig.from_dict(
        {
            "headers": HEADERS,
            "continue-on-failure": True,
            "request-timeout": 20,
            "generation": few,
            "dictionaries": {"names": {"values": ["CSS", "blue cup", "grasp", "grasp-1", "IJS.grasp"]}},
            "parameters": {
                f"path.{name}": {"dictionary": "names", "probability": 0.5}
                for name in ("module", "snapshot", "name", "task", "demonstration_id")
            },
            "phases": {"stateful": {"max-steps": 8}},
            "operations": OPERATIONS,
        }
    )


def arrays() -> st.SearchStrategy[bytes]:
    """Files with samples or queries of a module of two inputs and two outputs, and what is none."""

    def file(count: int) -> st.SearchStrategy[bytes]:
        rows = np.zeros((count, 2))
        more = {
            "outputs": st.just(rows),
            "demonstrations": st.just(np.array(["a"] * count, "U1")),
            "neighbours": st.integers(-1, 1001),
        }
        return st.fixed_dictionaries({"inputs": st.just(rows)}, optional=more).map(lambda named: packed(**named))

    return st.integers(0, 4).flatmap(file) | st.binary(max_size=100)


schemathesis.openapi.media_type("application/x-npz", arrays())
schemathesis.openapi.media_type("application/vnd.sqlite3", st.binary(max_size=100))


@schemathesis.serializer("application/x-npz", "application/vnd.sqlite3")  # type: ignore[arg-type]
def as_it_is(_context: schemathesis.SerializationContext, value: Any) -> dict[str, bytes]:
    return {"data": value if isinstance(value, bytes) else str(value).encode()}


@pytest.fixture
def taught(lab: Lab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Lab:
    """The lab with something of everything."""
    # The document's example of a key comes with every request: they would all be the same one. See test_once.py.
    monkeypatch.setattr(replies, "remembered", lambda *_: None)
    monkeypatch.setattr(replies, "remember", lambda *_: None)
    lab.coordinator.settings = lab.coordinator.settings.model_copy(update={"data_dir": tmp_path})
    lab.access = replace(lab.access, limits=lab.access.limits.model_copy(update={"wrong_tokens": 10**9}))
    lab.teach(lab.places[:3])
    lab.train()
    with asking(lab) as http:
        for path, body in (
            ("/v1/modules", declaration("CSS")),
            ("/v1/modules/CSS/samples", samples(30, demonstration="grasp-1")),
            ("/v1/modules/CSS/snapshots", {"name": "blue cup"}),
        ):
            assert http.post(path, json=body).status_code == 201
    return lab


@pytest.mark.timeout(3600 if EXAMPLES else 300)
def test_nothing_is_found(taught: Lab) -> None:
    # Streams of pictures go on until the coordinator ends: for them it has. See test_cameras.py.
    taught.coordinator.closing.set()
    found: dict[str, str] = {}
    statuses: Counter[int] = Counter()
    with (
        closing(socket.create_server(("127.0.0.1", 0))) as listener,
        http_server(taught.app(), listener, threading.Event()),
        structlog.testing.capture_logs(),
    ):
        at = f"http://127.0.0.1:{listener.getsockname()[1]}/v1/openapi.json"
        schema = schemathesis.openapi.from_url(at, config=configuration(), headers=HEADERS)
        for event in from_schema(schema).execute():
            if isinstance(event, events.ScenarioFinished):
                for interaction in event.recorder.interactions.values():
                    if interaction.response is not None:
                        statuses[interaction.response.status_code] += 1
                for case, checks in event.recorder.checks.items():
                    for check in checks:
                        if check.failure_info is not None:
                            asked = event.recorder.interactions[case]
                            found[f"{event.recorder.label}: {check.name}"] = (
                                f"{check.failure_info.failure.message}\n{asked.request.method} {asked.request.uri} "
                                f"{asked.request.body!r} -> {asked.response and asked.response.content!r}"
                            )
            elif isinstance(event, events.NonFatalError | events.FatalError):
                found[str(event.id)] = repr(event)
    assert not found, "\n\n".join(f"{where}\n{what}" for where, what in found.items())
    assert 500 not in statuses
    # It got through to what the routes do, not only to what refuses.
    assert statuses[200] > 50, statuses
    assert statuses[201] > 20, statuses
    assert statuses[202] > 20, statuses
