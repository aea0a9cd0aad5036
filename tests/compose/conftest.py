from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from handeye.client import Client

ROOT = Path(__file__).parents[2]
READY_LIMIT = 60.0


@dataclass(frozen=True)
class Containers:
    """The stack of `docker-compose.yml` that tools/check-compose has brought up; the environment says which."""

    url: str

    def compose(self, *arguments: str, token: str = "") -> str:
        """What `docker compose ARGUMENTS` printed; it must succeed."""
        return self._done(["docker", "compose", *arguments], os.environ | {"HANDEYE_TOKEN": token})

    def inside(self, service: str, *command: str) -> str:
        """What `command` printed in a service's container."""
        return self.compose("exec", "-T", service, *command)

    def inspect(self) -> dict[str, dict[str, Any]]:
        """What Docker knows of the containers, by service."""
        numbers = self.compose("ps", "--all", "--quiet").split()
        found = json.loads(self._done(["docker", "inspect", *numbers], dict(os.environ)))
        return {each["Config"]["Labels"]["com.docker.compose.service"]: each for each in found}

    @staticmethod
    def _done(command: list[str], environment: dict[str, str]) -> str:
        ended = subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=240, check=False
        )
        assert ended.returncode == 0, f"{command}\n{ended.stdout[-2000:]}\n{ended.stderr[-4000:]}"
        return ended.stdout


@pytest.fixture(scope="session")
def containers() -> Containers:
    if "HANDEYE_COMPOSE_URL" not in os.environ:
        pytest.skip("tools/check-compose builds and starts the containers and runs these tests")
    return Containers(os.environ["HANDEYE_COMPOSE_URL"])


@pytest.fixture(scope="session")
def token(containers: Containers) -> str:
    return containers.inside("server", "cat", "/data/first-token").strip()


@pytest.fixture
def client(containers: Containers, token: str) -> Iterator[Client]:
    with Client(containers.url, token) as client:
        client.wait_ready(READY_LIMIT)
        yield client
