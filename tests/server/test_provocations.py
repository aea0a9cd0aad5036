"""What people try in order to bring a server down: every operation, with what no schema would make."""

from __future__ import annotations

import threading
import time
from collections import Counter
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
import pytest

from tests.server.rest import NPZ, broken, declaration, packed, problem, samples, taught

if TYPE_CHECKING:
    from collections.abc import Callable

    import httpx2
    from starlette.testclient import TestClient

    from tests.server.conftest import Lab

JSON = {"Content-Type": "application/json"}

BODIES = [
    b"",
    b" ",
    b"null",
    b"[]",
    b"0",
    b'""',
    b"{",
    b"\x00",
    b"\xff\xfe\x00",
    b"\xef\xbb\xbf{}",
    b'{"a": NaN}',
    b'{"a": 1e999}',
    b'{"a": ' + b"9" * 5000 + b"}",
    b"[" * 20_000 + b"]" * 20_000,
    b'{"a":' * 5_000 + b"1" + b"}" * 5_000,
    b'{"name": "\\ud800"}',
    b'{"name": "\\u0000", "task": "\\u0000", "object": "\\u0000", "holder": "\\u0000", "reason": "\\u0000"}',
    b'{"name": "' + b"x" * 100_000 + b'"}',
    b'{"__proto__": {}, "constructor": 1, "": 2}',
    b"{" + b",".join(b'"k%d": 1' % n for n in range(2000)) + b"}",
]

NAMES = [
    "\u00e9",
    "a b",
    ".",
    "..",
    "-",
    "a\n",
    "a\u202eb",
    "%2e%2e",
    "%",
    "\U0001f916",
    "x" * 300,
    "';--",
    "a;b",
    "a?b",
    "a#b",
]

QUERIES = [
    "limit=9999999999999999999999",
    "limit=%00",
    "limit=1&limit=2",
    "cursor=%ff%fe",
    "cursor=" + "W" * 400,
    "number=" + "9" * 400,
    "number=1e5&number=-0",
    "category=nan&category=1e400",
    "not_older_than=1e400",
    "rate=1e-400",
    "name=%ed%a0%80",
    "&&&===",
    "%",
]

HEADERS: list[dict[bytes, bytes]] = [
    {b"Last-Event-ID": b"9" * 400},
    {b"Last-Event-ID": b"\xe9"},
    {b"Control-Lease": b"\xff" * 100},
    {b"Idempotency-Key": b"\xff"},
    {b"Accept": b"\xff;q=\xff,,,;"},
    {b"Content-Type": b"application/json; charset=utf-99"},
    {b"Content-Type": b"\xff\xff"},
    {b"Content-Type": b"multipart/form-data"},
    {b"Content-Encoding": b"gzip"},
    {b"Host": b"["},
    {b"X-Request-ID": b"\xff\r"},
]


@pytest.fixture
def operations(lab: Lab, http: TestClient) -> list[tuple[str, str]]:
    """Every (method, path) but the streams of pictures, which do not end."""
    lab.teach(lab.places[:2])
    lab.train()
    http.post("/v1/modules", json=declaration())
    http.post("/v1/modules/map/samples", json=samples(5))
    paths = http.get("/v1/openapi.json").json()["paths"]
    return [(method.upper(), path) for path in paths if "stream" not in path for method in paths[path]]


def filled(path: str, name: str) -> str:
    for parameter in ("module", "snapshot", "name", "demonstration_id", "task", "job_id", "token_id"):
        path = path.replace(f"{{{parameter}}}", quote(name, safe=""))
    return path.replace("{number}", "0").replace("{camera}", "left")


def check(response: httpx2.Response, *asked: object) -> None:
    """Nothing failed in a way that was not foreseen, and refusals are problems."""
    assert response.status_code < 500 or response.status_code == 504, (asked, response.status_code, response.text)
    if response.status_code >= 400:
        assert response.headers["content-type"] == "application/problem+json", asked
        assert response.json()["detail"], asked


def test_bodies_of_nonsense(http: TestClient, operations: list[tuple[str, str]]) -> None:
    for method, path in operations:
        if method in ("POST", "PUT", "PATCH"):
            for body in BODIES:
                for kind in (JSON, NPZ, {}):
                    response = http.request(method, filled(path, "map"), content=body, headers=kind)
                    check(response, method, path, body[:50], kind)


def test_names_queries_and_headers_of_nonsense(http: TestClient, operations: list[tuple[str, str]]) -> None:
    for method, path in operations:
        for name in NAMES if "{" in path else ():
            check(http.request(method, filled(path, name), json={}), method, path, name)
        for query in QUERIES:
            check(http.request(method, f"{filled(path, 'map')}?{query}"), method, path, query)
        for header in HEADERS:
            check(http.request(method, filled(path, "map"), headers=header, content=b"{}"), method, path, header)


def test_too_much_at_once_is_refused_with_a_sentence(http: TestClient) -> None:
    http.post("/v1/modules", json=declaration(neighbours=1000))
    inputs, outputs = taught(2000)
    http.post("/v1/modules/map/samples", content=packed(inputs=inputs, outputs=outputs), headers=NPZ)
    asked = {"inputs": taught(10_000)[0].tolist(), "neighbours": 1000}
    assert "fewer neighbours" in problem(http.post("/v1/modules/map/query", json=asked), 422, "invalid_argument")
    keys = b'{"inputs":[[0,0]],' + b",".join(b'"k%d":0' % n for n in range(50_000)) + b"}"
    wrong = http.post("/v1/modules/map/query", content=keys, headers=JSON)
    assert "more keys" in problem(wrong, 422, "invalid_argument")


def test_modules_that_come_and_go_while_they_are_asked(lab: Lab, http: TestClient) -> None:
    """Of another shape each time, and everything else that can be done to them at the same time."""
    stop, statuses, errors = time.monotonic() + 4.0, Counter[int](), list[BaseException]()
    flat, deep = declaration(), declaration(category=True, method="nearest")

    def again(do: Callable[[int], httpx2.Response]) -> None:
        turn = 0
        try:
            while time.monotonic() < stop:
                turn += 1
                response = do(turn)
                statuses[response.status_code] += 1
                check(response, turn)
        except BaseException as error:
            errors.append(error)

    def remake(turn: int) -> httpx2.Response:
        http.delete("/v1/modules/map")
        return http.post("/v1/modules", json=deep if turn % 2 else flat)

    def add(_turn: int) -> httpx2.Response:
        return http.post("/v1/modules/map/samples", json=samples(20, demonstration="a-1"))

    def look(turn: int) -> httpx2.Response:
        return http.get(
            f"/v1/modules{('', '/map', '/map/statistics', '/map/tree', '/map/samples', '/map/export')[turn % 6]}"
        )

    def ask(turn: int) -> httpx2.Response:
        queries = np.zeros((40, 2 + turn % 2))
        return http.post("/v1/modules/map/query", content=packed(inputs=queries), headers=NPZ)

    def keep(turn: int) -> httpx2.Response:
        if turn % 3 == 0:
            return http.post("/v1/modules/map/snapshots", json={"name": f"s{turn % 2}"})
        return http.post(f"/v1/modules/map/snapshots/s{turn % 2}/rollback")

    def take_out(turn: int) -> httpx2.Response:
        more: dict[str, Any] = {"demonstration": "a-1"} if turn % 2 else {"number": [0, 1]}
        return http.delete("/v1/modules/map/samples", params=more)

    def train(_turn: int) -> httpx2.Response:
        return http.post("/v1/modules/map/train")

    def jobs(_turn: int) -> httpx2.Response:
        return http.get("/v1/jobs", params={"limit": 5})

    works = (remake, add, add, look, look, ask, ask, keep, take_out, train, jobs)
    threads = [threading.Thread(target=again, args=(work,)) for work in works]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    assert errors == []
    assert statuses[200] > 20, statuses
    assert statuses[201] > 5, statuses
    for job in lab.coordinator.jobs.page(None, 100)[0]:
        assert job.error is None or job.error.code != "internal", job


def test_a_full_disk_is_told_and_changes_nothing(lab: Lab, http: TestClient) -> None:
    lab.teach(lab.places[:2])
    lab.train()
    http.post("/v1/modules", json=declaration())
    http.post("/v1/modules/map/samples", json=samples(20, demonstration="grasp-1"))
    http.post("/v1/modules/map/snapshots", json={"name": "s"})
    lease = {"Control-Lease": http.post("/v1/robot/lease", json={"holder": "alice"}).json()["lease"]}

    def everything() -> dict[str, Any]:
        paths = (
            "modules",
            "modules/map/samples",
            "modules/map/snapshots",
            "demonstrations",
            "objects",
            "tasks",
            "jobs",
        )
        told = {path: http.get(f"/v1/{path}").json() for path in (*paths, "tokens")}
        query = {"inputs": taught(5, seed=3)[0].tolist()}
        return told | {"answers": http.post("/v1/modules/map/query", json=query).json()}

    before = everything()
    with broken(lab.coordinator.store):
        for method, path, body in (
            ("POST", "modules", declaration("other")),
            ("DELETE", "modules/map", None),
            ("POST", "modules/map/samples", samples(3)),
            ("DELETE", "modules/map/samples?number=1", None),
            ("DELETE", "modules/map/samples?demonstration=grasp-1", None),
            ("POST", "modules/map/snapshots", {"name": "t"}),
            ("POST", "modules/map/snapshots/s/rollback", None),
            ("DELETE", "modules/map/snapshots/s", None),
            ("POST", "modules/map/train", None),
            ("POST", "tasks/grasp/train", None),
            ("DELETE", "tasks/grasp", None),
            ("POST", "demonstrations", {"task": "grasp", "object": "blue cup"}),
            ("PATCH", "demonstrations/grasp-1", {"outcome": "failure"}),
            ("DELETE", "demonstrations/grasp-1", None),
            ("POST", "objects/blue cup/examples", None),
            ("DELETE", "objects/blue cup", None),
            ("POST", "tokens", {"name": "a", "role": "viewer", "days": None}),
            ("POST", "robot/actions/park", None),
        ):
            response = http.request(method, f"/v1/{path}", json=body, headers=lease)
            assert "disk may be full" in problem(response, 503, "store_failed"), path
        # What needs no store goes on.
        assert http.get("/v1/robot", headers=lease).status_code == 200
        assert http.post("/v1/robot/stop").status_code == 200
    assert everything() == before
    assert lab.sight.learned == {"blue cup": (2, 2)}
    assert lab.robot.commands == ["stop"]
    assert lab.coordinator.jobs.acting is None
    http.post("/v1/robot/reset")
    assert http.post("/v1/robot/actions/park", headers=lease).status_code == 202
