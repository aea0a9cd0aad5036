"""A small application behind the real gate: each test makes its own, with the limits that it needs."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import pytest
import structlog
from fastapi import FastAPI, Request
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, ConfigDict, Field, SecretStr
from starlette.testclient import TestClient

from handeye.server import problem_responses
from handeye.server.access import Access, LimitSettings, Role, Tokens
from handeye.server.metrics import Metrics
from handeye.server.store import Store

ADMIN = "the-configured-token"


class Thing(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    name: Annotated[str, Field(pattern=r"^\w[\w .-]{0,62}$")]
    value: float = 0.0
    count: int = 0


async def _drops() -> AsyncIterator[bytes]:
    while True:
        yield b"drop\n"
        await asyncio.sleep(0.01)


def small_app(access: Access) -> FastAPI:
    app = FastAPI(openapi_url="/v1/openapi.json")
    problem_responses.install(app)
    access.install(app)

    @app.get("/healthz")
    async def healthz() -> dict[str, str]:
        return {"status": "ok"}

    @app.get("/metrics")
    async def metrics() -> dict[str, str]:
        return {}

    @app.get("/v1/things/{name}")
    async def get_thing(name: str) -> Thing:
        structlog.get_logger().info("read")
        return Thing(name=name)

    @app.post("/v1/things", status_code=201)
    def add_thing(thing: Thing) -> Thing:
        structlog.get_logger().info("added in a thread")
        return thing

    @app.post("/v1/modules/{module}/query")
    async def query(module: str) -> dict[str, str]:
        return {"module": module}

    @app.post("/v1/robot/stop")
    async def stop() -> dict[str, bool]:
        return {"stopped": True}

    @app.post("/v1/upload")
    @app.post("/v1/restore")
    async def upload(request: Request) -> dict[str, int]:
        return {"bytes": len(await request.body())}

    @app.post("/v1/careless")
    async def careless(request: Request) -> dict[str, int]:
        try:
            return {"bytes": len(await request.body())}
        except Exception:
            return {"bytes": 0}

    @app.get("/v1/broken")
    def broken() -> None:
        password = "local-variables-stay-out"
        raise ZeroDivisionError(f"{len(password)} divided by zero")

    @app.get("/v1/broken-stream")
    async def broken_stream() -> StreamingResponse:
        async def pieces() -> AsyncIterator[bytes]:
            yield b"one"
            raise ZeroDivisionError("in the middle")

        return StreamingResponse(pieces())

    @app.get("/v1/stream")
    async def stream() -> StreamingResponse:
        return StreamingResponse(_drops())

    return app


@dataclass
class Site:
    """An application, its store, and a client for whoever is named."""

    store: Store
    limits: LimitSettings = field(default_factory=LimitSettings)
    configured: SecretStr | None = field(default_factory=lambda: SecretStr(ADMIN))

    def __post_init__(self) -> None:
        self.tokens = Tokens(self.store, self.configured)
        self.metrics = Metrics()
        self.app = small_app(Access(self.tokens, self.limits, self.metrics))

    def secret(self, role: Role, days: float | None = None) -> str:
        return self.tokens.create(f"a {role}", role, days)[1]

    def client(self, secret: str | None = ADMIN, address: str = "192.0.2.7") -> TestClient:
        headers = {} if secret is None else {"Authorization": f"Bearer {secret}"}
        return TestClient(self.app, headers=headers, raise_server_exceptions=False, client=(address, 50000))

    def counted(self, name: str, **labels: str) -> float:
        return self.metrics.registry.get_sample_value(name, labels) or 0.0


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with Store.open(f"sqlite:///{tmp_path}/handeye.db") as store:
        yield store


@pytest.fixture
def site(store: Store) -> Site:
    return Site(store)


@pytest.fixture
def http(site: Site) -> TestClient:
    """A client with the configured token."""
    return site.client()


def sentence(response: Any, status: int, code: str) -> str:
    """Checks that `response` is a problem (RFC 9457) and returns its sentence."""
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    found = problem_responses.Problem.model_validate(response.json())
    assert (found.status, found.code) == (status, code)
    return found.detail


def raw_request(site: Site, method: str, path: str, **more: Any) -> dict[str, Any]:
    """A request as no client would send it."""
    scope = {
        "type": "http",
        "method": method,
        "path": path,
        "query_string": b"",
        "headers": [(b"authorization", b"Bearer the-configured-token")],
        "client": None,
        "root_path": "",
        **more,
    }
    sent: list[Any] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: Any) -> None:
        sent.append(message)

    asyncio.run(site.app(scope, receive, send))
    return {"status": sent[0]["status"], "body": json.loads(sent[1]["body"])}
