"""Pictures over REST: one at a time in three forms, and as they come."""

from __future__ import annotations

import asyncio
import io
import threading
import time
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest

from handeye.rpc.errors import Unavailable
from tests.server.conftest import TOKEN
from tests.server.rest import problem

if TYPE_CHECKING:
    from fastapi import FastAPI
    from starlette.testclient import TestClient

    from tests.server.conftest import Lab


class Viewer:
    """Somebody who looks at a stream: reads what comes until they leave."""

    def __init__(self, app: FastAPI, path: str, query: bytes = b"rate=30") -> None:
        self.status = 0
        self.headers: dict[bytes, bytes] = {}
        self.body = bytearray()
        self.left = asyncio.Event()
        self._asked = False
        scope: dict[str, Any] = {
            "type": "http",
            "asgi": {"version": "3.0", "spec_version": "2.3"},
            "http_version": "1.1",
            "method": "GET",
            "path": path,
            "raw_path": path.encode(),
            "query_string": query,
            "headers": [(b"authorization", f"Bearer {TOKEN}".encode())],
            "client": ("127.0.0.1", 1),
            "server": ("127.0.0.1", 80),
            "scheme": "http",
            "root_path": "",
        }
        self.task = asyncio.ensure_future(app(scope, self._receive, self._send))

    async def _receive(self) -> dict[str, Any]:
        if not self._asked:
            self._asked = True
            return {"type": "http.request", "body": b"", "more_body": False}
        await self.left.wait()
        return {"type": "http.disconnect"}

    async def _send(self, message: Any) -> None:
        if message["type"] == "http.response.start":
            self.status, self.headers = message["status"], dict(message["headers"])
        else:
            self.body += message["body"]

    async def until(self, condition: Callable[[], bool]) -> None:
        """Waits for a condition."""
        deadline = time.monotonic() + 5.0
        while not condition():
            assert time.monotonic() < deadline, "it never came"
            await asyncio.sleep(0.01)

    @property
    def pictures(self) -> int:
        return bytes(self.body).count(b"--frame\r\n")


def viewing(see: Callable[[], Awaitable[None]]) -> None:
    """Runs `see` to its end."""

    async def run() -> None:
        await asyncio.wait_for(see(), 30.0)

    asyncio.run(run())


def test_a_picture_comes_as_it_is_asked_for(lab: Lab, http: TestClient) -> None:
    seen = np.random.default_rng(1).integers(0, 256, (48, 64, 3), np.uint8)
    grab = lab.cameras.grab_stereo

    def coloured(*arguments: Any) -> Any:
        pair = grab(*arguments)
        pair.left.image[:] = seen
        return pair

    lab.cameras.grab_stereo = coloured  # type: ignore[method-assign, assignment]
    for asked, kind in (
        ("image/png", "image/png"),
        ("application/x-npy", "application/x-npy"),
        ("text/html, image/png;q=0.9", "image/png"),
        ("*/*", "image/jpeg"),
        ("image/jpeg", "image/jpeg"),
        ("text/html", "image/jpeg"),
    ):
        response = http.get("/v1/cameras/left/frame", headers={"Accept": asked})
        assert response.headers["content-type"] == kind, asked
        assert float(response.headers["world-time"]) == pytest.approx(0.95)
        if kind == "application/x-npy":
            image = np.load(io.BytesIO(response.content), allow_pickle=False)
        else:
            decoded = cv2.imdecode(np.frombuffer(response.content, np.uint8), cv2.IMREAD_COLOR)
            assert decoded is not None
            image = cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB)
        assert image.shape == seen.shape
        if kind != "image/jpeg":
            np.testing.assert_array_equal(image, seen)


def test_a_stream_has_jpegs_that_differ_and_ends_when_the_viewer_leaves(lab: Lab) -> None:
    app = lab.app()

    async def see() -> None:
        viewer = Viewer(app, "/v1/cameras/left/stream")
        await viewer.until(lambda: viewer.pictures >= 3)
        assert viewer.status == 200
        assert viewer.headers[b"content-type"] == b"multipart/x-mixed-replace; boundary=frame"
        _, part, *_ = bytes(viewer.body).split(b"--frame\r\n")
        head, _, picture = part.partition(b"\r\n\r\n")
        length = int(dict(line.split(b": ") for line in head.split(b"\r\n"))[b"Content-Length"])
        assert len(picture) == length + 2
        assert picture[:2] == b"\xff\xd8"
        assert app.state.lanes.streams == 1
        viewer.left.set()
        await viewer.task
        assert app.state.lanes.streams == 0

    viewing(see)


def test_a_picture_that_was_sent_is_not_sent_again(lab: Lab) -> None:
    app = lab.app()
    grab = lab.cameras.grab_stereo

    def same(*arguments: Any) -> Any:
        lab.cameras.sequence = 0
        return grab(*arguments)

    lab.cameras.grab_stereo = same  # type: ignore[method-assign, assignment]

    async def see() -> None:
        viewer = Viewer(app, "/v1/cameras/observer/stream")
        await viewer.until(lambda: viewer.pictures == 1)
        await asyncio.sleep(0.2)
        assert viewer.pictures == 1
        viewer.left.set()  # also while nothing is sent
        await viewer.task
        assert app.state.lanes.streams == 0

    viewing(see)


def test_a_stream_outlives_cameras_that_cannot_be_reached(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("handeye.server.routes.cameras._RETRY", 0.05)
    app = lab.app()

    async def see() -> None:
        lab.cameras.fail_with = Unavailable("nobody serves Camera")
        viewer = Viewer(app, "/v1/cameras/right/stream")
        await viewer.until(lambda: viewer.status == 200)
        await asyncio.sleep(0.1)
        lab.cameras.fail_with = None
        await viewer.until(lambda: viewer.pictures > 1)
        viewer.left.set()
        await viewer.task

    viewing(see)


@pytest.mark.parametrize("query", [b"rate=30", b"rate=0.1"])
def test_streams_end_with_the_coordinator(lab: Lab, query: bytes) -> None:
    app = lab.app()

    async def see() -> None:
        viewer = Viewer(app, "/v1/cameras/left/stream", query)
        await viewer.until(lambda: viewer.pictures >= 1)
        threading.Thread(target=lab.coordinator.close).start()
        await asyncio.wait_for(viewer.task, 1.5)
        assert app.state.lanes.streams == 0

    viewing(see)


def test_there_are_four_streams_at_most_also_when_all_come_at_once(lab: Lab) -> None:
    app = lab.app()

    async def see() -> None:
        viewers = [Viewer(app, "/v1/cameras/left/stream") for _ in range(12)]
        await viewers[0].until(lambda: all(viewer.status for viewer in viewers))
        refused = [viewer for viewer in viewers if viewer.status == 429]
        shown = [viewer for viewer in viewers if viewer.status == 200]
        assert (len(shown), len(refused)) == (4, 8)
        assert all(b"retry-after" in viewer.headers for viewer in refused)
        assert b"4 streams" in bytes(refused[0].body)
        for viewer in viewers:
            viewer.left.set()
        await asyncio.gather(*(viewer.task for viewer in viewers))
        assert app.state.lanes.streams == 0

    viewing(see)


def test_a_viewer_who_leaves_before_the_first_picture_leaves_nothing(lab: Lab) -> None:
    app = lab.app()

    async def see() -> None:
        lab.cameras.gate = threading.Event()
        for _ in range(6):
            viewer = Viewer(app, "/v1/cameras/left/stream")
            viewer.left.set()
            await asyncio.sleep(0.05)
            lab.cameras.gate.set()
            await viewer.task
            lab.cameras.gate.clear()
            assert app.state.lanes.streams == 0
        lab.cameras.gate.set()

    viewing(see)


def test_how_often_has_bounds(http: TestClient) -> None:
    for rate in ("0", "-1", "31", "nan", "inf", "often", "0.001"):
        problem(http.get("/v1/cameras/left/stream", params={"rate": rate}), 422, "invalid_argument")
    for since in ("-1", "nan", "inf", "-inf"):
        wrong = http.get("/v1/cameras/left/frame", params={"not_older_than": since})
        problem(wrong, 422, "invalid_argument")
