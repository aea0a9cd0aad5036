"""The server is killed while samples are written to it: what it acknowledged is there, and nothing is there twice."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import httpx2
import pytest

from handeye.cli.up import LOOPBACK, free_ports
from handeye.client import Client, HandeyeError
from handeye.rpc import Bus, BusSettings

KILLS = int(os.environ.get("HANDEYE_SOAK", "5"))

pytestmark = [pytest.mark.system, pytest.mark.timeout(120 + 20 * KILLS)]

TOKEN = "a-token-for-tests"
BATCH = 50
SEED = 20261125
DECLARATION = {
    "name": "CSS",
    "inputs": [{"name": "batch", "unit": ""}, {"name": "place", "unit": ""}],
    "outputs": [{"name": "sum", "unit": ""}],
}


class Site:
    """A store, and the server that is started on it again and again."""

    def __init__(self, folder: Path, bus: BusSettings, port: int) -> None:
        self.folder = folder
        self.url = f"http://{LOOPBACK}:{port}"
        self._environment = os.environ | {
            "HANDEYE_BUS_ENDPOINT": bus.endpoint,
            "HANDEYE_SERVER_PORT": str(port),
            "HANDEYE_SERVER_TOKEN": TOKEN,
            "HANDEYE_SERVER_DATA_DIR": str(folder),
            "HANDEYE_DATABASE_URL": f"sqlite:///{folder / 'handeye.db'}",
        }

    def command(self, *words: str) -> list[str]:
        return [sys.executable, "-m", "handeye.cli.main", *words]

    @contextmanager
    def server(self) -> Iterator[subprocess.Popen[bytes]]:
        """A server that answers."""
        with (self.folder / "server.log").open("ab") as log:
            process = subprocess.Popen(self.command("server"), env=self._environment, stdout=log, stderr=log)
        try:
            deadline = time.monotonic() + 60.0
            with Client(self.url, TOKEN) as client:
                while not self._loaded(client):
                    assert process.poll() is None, (self.folder / "server.log").read_text()[-3000:]
                    assert time.monotonic() < deadline, "the server did not become ready"
                    time.sleep(0.02)
            yield process
        finally:
            process.kill()
            process.wait()

    def _loaded(self, client: Client) -> bool:
        """Its trees are built: only the bridges are missing, which nobody here wants."""
        try:
            missing = client.not_ready() or ""
        except HandeyeError:
            return False
        return not any(word in missing for word in ("kernels", "modules", "started"))

    def verify(self) -> str:
        done = subprocess.run(
            self.command("verify"), env=self._environment, capture_output=True, text=True, timeout=60, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    bus_port, port = free_ports(2)
    bus = BusSettings(endpoint=f"tcp/{LOOPBACK}:{bus_port}")
    with Bus.host(bus, {}, name="router"):
        yield Site(tmp_path, bus, port)


def write(http: httpx2.Client, batch: int) -> bool:
    """Sends a batch under a key of its own; whether it was acknowledged."""
    samples = [{"input": [batch, place], "output": [batch + place], "demonstration": "shown"} for place in range(BATCH)]
    headers = {"Idempotency-Key": f"batch-{batch}"}
    with suppress(httpx2.HTTPError):
        response = http.post("/v1/modules/CSS/samples", json={"samples": samples}, headers=headers)
        assert response.status_code == 201, response.text
        assert response.json()["count"] == BATCH
        return True
    return False


def test_what_was_acknowledged_survives_every_kill_and_nothing_is_there_twice(site: Site) -> None:
    chance = random.Random(SEED)
    batch, acknowledged = 0, set[int]()
    for kill in range(KILLS):
        with site.server() as process:
            headers = {"Authorization": f"Bearer {TOKEN}"}
            with httpx2.Client(base_url=site.url, headers=headers, timeout=30.0) as http:
                if kill == 0:
                    assert http.post("/v1/modules", json=DECLARATION).status_code == 201
                elif write(http, batch):  # as a client does who never heard of its last batch
                    acknowledged.add(batch)
                    batch += 1
                # At any moment of some request.
                killer = threading.Timer(chance.uniform(0.02, 0.6), process.kill)
                killer.start()
                while write(http, batch):
                    acknowledged.add(batch)
                    batch += 1
                killer.join()
        site.verify()
    with site.server(), Client(site.url, TOKEN) as client:
        found = Counter(tuple(sample.input) for sample in client.samples("CSS"))
        answer = client.query("CSS", [[float(batch // 2), 3.0]])
    assert len(acknowledged) >= KILLS
    assert set(found.values()) == {1}
    for each in acknowledged:
        assert all((each, place) in found for place in range(BATCH)), f"batch {each} was acknowledged and is lost"
    # A batch that nobody heard of is there whole, or not at all.
    rest = {int(number) for number, _place in found} - acknowledged
    assert all((number, place) in found for number in rest for place in range(BATCH))
    assert answer.outputs.shape == (1, 1)
