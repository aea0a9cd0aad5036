"""Parts of a stream, however its bytes are cut into pieces."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from handeye.client._multipart import Parts, boundary_of

BOUNDARY = b"--frame"


def stream(pictures: list[bytes], *, lengths: bool) -> bytes:
    text = b"an introduction that nobody reads\r\n"
    for picture in pictures:
        length = f"Content-Length: {len(picture)}\r\n".encode() if lengths else b""
        text += BOUNDARY + b"\r\nContent-Type: image/jpeg\r\n" + length + b"\r\n" + picture + b"\r\n"
    return text + BOUNDARY + b"--\r\n"


@given(st.lists(st.binary(max_size=40)), st.lists(st.integers(1, 30), min_size=1), st.booleans())
def test_pictures_come_whole(pictures: list[bytes], cuts: list[int], lengths: bool) -> None:
    if not lengths:
        pictures = [picture.replace(b"-", b"+") for picture in pictures]
    text, parts = stream(pictures, lengths=lengths), Parts(BOUNDARY)
    found: list[bytes] = []
    while text:
        size = cuts[len(text) % len(cuts)]
        found += parts.feed(text[:size])
        text = text[size:]
    assert found == pictures


def test_a_boundary_inside_a_picture_of_known_length_is_none() -> None:
    picture = b"\xff\xd8 \r\n--frame\r\n \xff\xd9"
    assert list(Parts(BOUNDARY).feed(stream([picture], lengths=True))) == [picture]


@pytest.mark.parametrize(
    ("content_type", "boundary"),
    [
        ("multipart/x-mixed-replace; boundary=frame", b"--frame"),
        ('multipart/x-mixed-replace; charset=x; boundary="frame"', b"--frame"),
        ("Multipart/X-Mixed-Replace;boundary=frame; more=1", b"--frame"),
    ],
)
def test_the_boundary_is_in_the_content_type(content_type: str, boundary: bytes) -> None:
    assert boundary_of(content_type) == boundary


@pytest.mark.parametrize("content_type", ["", "image/jpeg", "multipart/mixed", "text/html; boundary=x"])
def test_another_stream_is_noticed(content_type: str) -> None:
    with pytest.raises(ValueError, match="multipart stream was asked for"):
        boundary_of(content_type)


def test_a_part_without_end_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("handeye.client._multipart._LARGEST", 100)
    parts = Parts(BOUNDARY)
    list(parts.feed(b"x" * 90))
    with pytest.raises(ValueError, match="larger than 100 bytes"):
        list(parts.feed(b"x" * 20))
