"""Pictures: as files, as arrays, as a stream."""

from __future__ import annotations

import io

import httpx2
import numpy as np
import pytest

from handeye.client import UnexpectedAnswer, Unreachable
from tests.client.conftest import Connect, Script


def npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def test_pictures_come_as_they_are_wanted(connect: Connect) -> None:
    coordinator = Script(httpx2.Response(200, content=b"picture"))
    with connect(coordinator) as client:
        assert client.frame("left", not_older_than=2.5) == b"picture"
        assert client.frame_png("observer") == b"picture"
        assert client.picture("/v1/jobs/j1/looks/0.jpg") == b"picture"
    assert [request.headers["accept"] for request in coordinator.asked[:2]] == ["image/jpeg", "image/png"]
    assert coordinator.asked[0].url.raw_path == b"/v1/cameras/left/frame?not_older_than=2.5"
    assert coordinator.asked[2].url.path == "/v1/jobs/j1/looks/0.jpg"


def test_a_picture_is_an_array(connect: Connect) -> None:
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    coordinator = Script(httpx2.Response(200, content=npy(pixels), headers={"World-Time": "12.500000"}))
    with connect(coordinator) as client:
        image = client.image("right")
    assert np.array_equal(image.pixels, pixels)
    assert image.pixels.dtype == np.uint8
    assert image.world_time == 12.5
    assert coordinator.asked[0].headers["accept"] == "application/x-npy"


@pytest.mark.parametrize("content", [b"", b"\xff\xd8 JPEG", npy(np.zeros((2, 2))), npy(np.array([{}], dtype=object))])
def test_what_is_no_picture_is_noticed(connect: Connect, content: bytes) -> None:
    coordinator = Script(httpx2.Response(200, content=content))
    with connect(coordinator) as client, pytest.raises(UnexpectedAnswer):
        client.image("left")


def stream(*pictures: bytes) -> httpx2.Response:
    parts = [b"--x\r\nContent-Length: %d\r\n\r\n%s\r\n" % (len(picture), picture) for picture in pictures]
    headers = {"content-type": "multipart/x-mixed-replace; boundary=x"}
    return httpx2.Response(200, headers=headers, content=b"".join(parts))


def test_a_stream_is_one_picture_after_the_other(connect: Connect) -> None:
    coordinator = Script(stream(b"one", b"two", b"three"))
    with connect(coordinator) as client:
        assert list(client.frames("left", rate=2.0)) == [b"one", b"two", b"three"]
        frames = client.frames("left")
        assert next(frames) == b"one"
        frames.close()
    assert coordinator.asked[0].url.raw_path == b"/v1/cameras/left/stream?rate=2.0"


def test_a_stream_of_something_else_is_noticed(connect: Connect) -> None:
    coordinator = Script(httpx2.Response(200, content=b"picture", headers={"content-type": "image/jpeg"}))
    with connect(coordinator) as client, pytest.raises(UnexpectedAnswer, match="multipart stream was asked for"):
        list(client.frames("left"))


def test_a_stream_that_cannot_be_had_says_why(connect: Connect) -> None:
    with connect(Script(httpx2.ConnectError("refused"))) as client, pytest.raises(Unreachable, match="refused"):
        list(client.frames("left"))
