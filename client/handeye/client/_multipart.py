"""The parts of a multipart stream (RFC 2046), taken from its bytes as they come."""

from __future__ import annotations

import re
from collections.abc import Iterator

_LARGEST = 64 * 2**20
"""Bytes of a part; more is no picture."""


def boundary_of(content_type: str) -> bytes:
    """What stands between the parts; `ValueError` when this is no multipart stream."""
    found = re.fullmatch(r"multipart/[\w-]+\s*;.*?boundary=\"?([^\";]+)\"?.*", content_type, re.IGNORECASE)
    if found is None:
        raise ValueError(f"a multipart stream was asked for, and {content_type!r} came")
    return b"--" + found[1].encode("latin-1")


class Parts:
    """The parts' bodies, each as soon as it is complete: at its Content-Length, else at the next boundary."""

    def __init__(self, boundary: bytes) -> None:
        self._boundary = boundary
        self._kept = b""

    def feed(self, data: bytes) -> Iterator[bytes]:
        """The parts that `data` completes; `ValueError` when it is none of a multipart stream."""
        self._kept += data
        while (part := self._next()) is not None:
            yield part
        if len(self._kept) > _LARGEST:
            raise ValueError(f"a part of a stream is larger than {_LARGEST} bytes")

    def _next(self) -> bytes | None:
        start = self._kept.find(self._boundary)
        head_end = self._kept.find(b"\r\n\r\n", start)
        if start < 0 or head_end < 0:
            return None
        head, begin = self._kept[start + len(self._boundary) : head_end], head_end + 4
        length = re.search(rb"\r\ncontent-length:\s*(\d+)\s*(?:\r\n|$)", head, re.IGNORECASE)
        end = begin + int(length[1]) if length else self._kept.find(b"\r\n" + self._boundary, begin)
        if end < 0 or end > len(self._kept):
            return None
        part, self._kept = self._kept[begin:end], self._kept[end:]
        return part
