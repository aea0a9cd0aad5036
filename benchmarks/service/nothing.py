"""A FastAPI application that does nothing, behind the service's middleware: what a request costs at the least."""

from __future__ import annotations

import sys

import uvicorn
from fastapi import FastAPI
from pydantic import SecretStr

from benchmarks.service.processes import TOKEN
from handeye.rpc.process import configure_logging
from handeye.server import problem_responses
from handeye.server.access import Access, LimitSettings, Tokens
from handeye.server.access.protocol import BoundedProtocol
from handeye.server.metrics import Metrics
from handeye.server.store import Store


def main() -> None:
    port, database = int(sys.argv[1]), sys.argv[2]
    configure_logging()
    app = FastAPI()
    problem_responses.install(app)

    @app.get("/readyz")
    async def ready() -> dict[str, str]:
        return {"status": "ok"}

    @app.post("/v1/modules/{module}/query")
    async def nothing(module: str) -> dict[str, str]:
        return {"module": module}

    with Store.open(f"sqlite:///{database}") as store:
        limits = LimitSettings(requests_per_second=1e9)
        Access(Tokens(store, SecretStr(TOKEN)), limits, Metrics()).install(app)
        uvicorn.run(
            app, port=port, http=BoundedProtocol, log_config=None, access_log=False, server_header=False, lifespan="off"
        )


if __name__ == "__main__":
    main()
