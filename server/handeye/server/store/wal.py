"""Reads SQLite's write-ahead log (sqlite.org/fileformat2.html#walformat), what lies behind damage in it too.

SQLite silently stops at the first frame whose checksum does not fit. After a crash that is the torn end of a write
that nobody was told of; but a byte that flipped further in front hides every transaction behind it. A frame carries
the running checksum up to itself, so those behind a damaged one can be told from leftovers. That they are there because
of damage is certain once a frame follows a commit: a transaction is on the disk before the next one begins.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

_HEADER, _FRAME = 32, 24  # bytes
_MAGIC = 0x377F0682  # the lowest bit says: big-endian checksums
PAGE_SIZE = 4096
"""Bytes of a page where a damaged header does not say it: SQLite's usual ones."""

_Sums = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Frame:
    """A page in the log."""

    page: int
    """Its number in the database, from 1."""
    size: int
    """Pages of the database after the transaction that ends here; 0 in the midst of one."""
    content: int
    """Where its content begins in the log."""


@dataclass(frozen=True, slots=True)
class Log:
    """The frames of a log up to the last commit, in order."""

    page_size: int
    frames: tuple[Frame, ...]
    """Damaged ones too, where whole ones are behind them: most of their rows may be whole."""
    read: int
    """So many of them does SQLite read; the others lie behind damage."""


def read_log(path: Path) -> Log:
    """What a log holds; nothing when there is none, or none that was ever written to."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        content = b""
    if len(content) < _HEADER:
        return Log(PAGE_SIZE, (), 0)
    magic, _, page_size, _, _, _, first, second = struct.unpack_from(">8I", content)
    order = ">" if magic == _MAGIC | 1 else "<"
    whole = magic & ~1 == _MAGIC and _sums(content[:24], order, (0, 0)) == (first, second)
    if whole:
        return _walk(content, page_size, order, content[16:24], (first, second))
    return _walk(content, PAGE_SIZE, order, content[_HEADER + 8 : _HEADER + 16], None)


def _walk(content: bytes, page_size: int, order: str, salts: bytes, start: _Sums | None) -> Log:
    """`start`: the running checksum at the first frame; None where the log's header does not say it."""
    frames: list[Frame] = []
    wholes: list[bool] = []
    sums = {start} if start else set()
    for at in range(_HEADER, len(content) - _FRAME - page_size + 1, _FRAME + page_size):
        page, size, _, _, first, second = struct.unpack_from(">6I", content, at)
        whole = False
        computed: set[_Sums] = set()
        if content[at + 8 : at + 16] == salts:
            body = content[at : at + 8] + content[at + _FRAME : at + _FRAME + page_size]
            computed = {_sums(body, order, before) for before in sums}
            whole = (first, second) in computed
        else:
            # Left over from before the log was begun anew, or damaged: the frames behind it tell.
            page = size = 0
        frames.append(Frame(page, size, at + _FRAME))
        wholes.append(whole)
        # Behind a damaged frame the sum is the one that it says, or the one of what it holds.
        sums = {(first, second)} if whole or len(computed) > 1 else {(first, second), *computed}
    commits = [frame.size > 0 for frame in frames]
    broken = wholes.index(False) if False in wholes else len(frames)
    read = max((i + 1 for i in range(broken) if commits[i]), default=0)
    last = max((i + 1 for i in range(len(frames)) if commits[i] and wholes[i]), default=0)
    first_commit = commits.index(True, broken) if True in commits[broken:] else len(frames)
    if not any(wholes[first_commit + 1 :]) and (start is not None or not last):
        return Log(page_size, tuple(frames[:read]), read)
    largest = frames[last - 1].size
    return Log(page_size, tuple(frame for frame in frames[:last] if 0 < frame.page <= largest), read)


def _sums(content: bytes, order: str, start: _Sums) -> _Sums:
    a, b = start
    words = struct.unpack(f"{order}{len(content) // 4}I", content)
    for even, odd in zip(words[::2], words[1::2], strict=True):
        a = (a + even + b) & 0xFFFFFFFF
        b = (b + odd + a) & 0xFFFFFFFF
    return a, b
