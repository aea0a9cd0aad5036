"""Reads the pages of an SQLite file without SQLite (sqlite.org/fileformat2.html): also of a file that it refuses.

Nothing of the file is trusted. What a cell holds is believed only by who calls, when a row's checksum fits.
"""

from __future__ import annotations

import mmap
import struct
from typing import Any, NamedTuple

from handeye.server.store.reading import decoded

INTERIOR_INDEX, INTERIOR_TABLE, LEAF_INDEX, LEAF_TABLE = 2, 5, 10, 13
"""Kinds of pages, as their first byte has them. A table WITHOUT ROWID is an index that holds everything."""

_MOST = 1000  # times more pages than there are: that is no truncated file, but a damaged number

Buffer = bytes | bytearray


class Cell(NamedTuple):
    """What may be a record on a page."""

    start: int
    end: int
    values: list[Any]
    """As SQLite keeps them, fewer when the record is cut off."""
    whole: bool
    """Its lengths fit together."""
    overflow: tuple[int, ...]
    """The pages that it goes on in."""


class Pages:
    """The pages of a database file, by number from 1."""

    def __init__(self, content: bytes | mmap.mmap, size: int) -> None:
        self._content = content
        self.size = size
        self.count = len(content) // size
        said = int.from_bytes(self._content[28:32])
        self.expected = said if self.count < said < _MOST * self.count else self.count
        """How many it should have; more than `count` when the file was cut off."""

    def page(self, number: int) -> bytes:
        """The content of a page; the first one's begins with the file's header."""
        return self._content[(number - 1) * self.size : number * self.size]

    def kind(self, number: int) -> int:
        """Its first byte, past the file's header."""
        return self._content[(number - 1) * self.size + header_at(number)]

    def pointers(self, number: int, page: Buffer) -> list[int]:
        """Where the page says that its cells are; only places that are possible."""
        first, count = self._array(number, page)
        found = struct.unpack_from(f">{count}H", page, first)
        return [place for place in found if first + 2 * count <= place <= self.size - 4]

    def content_start(self, number: int, page: Buffer) -> int:
        """Where its cells begin; past the pointers to them when the page does not say it well."""
        first, count = self._array(number, page)
        at = header_at(number)
        said = int.from_bytes(page[at + 5 : at + 7]) or 1 << 16
        return min(said if first + 2 * count <= said <= self.size else first, self.size, *self.pointers(number, page))

    def is_filled(self, number: int, page: Buffer, cells: list[Cell]) -> bool:
        """Whether these cells and its free blocks fill its content: then it has no others."""
        at = header_at(number)
        free, block, blocks = page[at + 7], int.from_bytes(page[at + 1 : at + 3]), 0
        while 0 < block <= self.size - 4 and blocks < self.size // 4:
            free += int.from_bytes(page[block + 2 : block + 4])
            block, blocks = int.from_bytes(page[block : block + 2]), blocks + 1
        start = int.from_bytes(page[at + 5 : at + 7]) or 1 << 16
        return sum(cell.end - cell.start for cell in cells) + free == self.size - start

    def _array(self, number: int, page: Buffer) -> tuple[int, int]:
        """Where its array of pointers begins, and how many there are, as far as that is possible."""
        at = header_at(number)
        first = at + (12 if page[at] in (INTERIOR_INDEX, INTERIOR_TABLE) else 8)
        return first, min(int.from_bytes(page[at + 3 : at + 5]), (self.size - first) // 2)

    def children(self, number: int) -> list[int]:
        """The pages below an interior page; none for a leaf, and none when one of them is impossible."""
        if self.kind(number) not in (INTERIOR_INDEX, INTERIOR_TABLE):
            return []
        page, at = self.page(number), header_at(number)
        places = [*self.pointers(number, page), at + 8]
        found = [int.from_bytes(page[place : place + 4]) for place in places]
        plausible = len(set(found)) == len(found) and all(1 < child <= self.expected for child in found)
        return found if plausible else []

    def below(self, root: int) -> set[int]:
        """All pages of the tree under `root`; also such as the file should have, but has not."""
        found: set[int] = set()
        waiting = [root]
        while waiting:
            number = waiting.pop()
            if number not in found:
                found.add(number)
                waiting.extend(self.children(number) if number <= self.count else ())
        return found

    def cell(self, page: Buffer, at: int, kind: int) -> Cell | None:
        """What stands at that place, if it can be a record at all."""
        start = at
        try:
            if kind == INTERIOR_INDEX:
                at += 4
            length, at = _varint(page, at)
            if kind == LEAF_TABLE:
                _, at = _varint(page, at)
            local = self._local(length, kind)
            end = at + local
            if end + (4 if local < length else 0) > self.size or length < 2 or length > len(self._content):
                return None
            payload = bytes(page[at:end])
            overflow: tuple[int, ...] = ()
            if local < length:
                payload, overflow = self._followed(payload, int.from_bytes(page[end : end + 4]), length)
                end += 4
            values = record(payload, length)
        except IndexError:
            return None
        if values is None:
            return None
        return Cell(start, max(end, start + 4), values, len(payload) == length, overflow)

    def _local(self, length: int, kind: int) -> int:
        """How many bytes of a record stand on its first page."""
        most = self.size - 35 if kind == LEAF_TABLE else (self.size - 12) * 64 // 255 - 23
        if length <= most:
            return length
        least = (self.size - 12) * 32 // 255 - 23
        fitting = least + (length - least) % (self.size - 4)
        return fitting if fitting <= most else least

    def _followed(self, payload: bytes, following: int, length: int) -> tuple[bytes, tuple[int, ...]]:
        """The record with what stands on its overflow pages; shorter than `length` where their chain is broken."""
        parts, left, seen = [payload], length - len(payload), dict[int, None]()
        while left > 0 and 1 <= following <= self.count and following not in seen:
            seen[following] = None
            page = self.page(following)
            parts.append(page[4 : 4 + min(left, self.size - 4)])
            left -= len(parts[-1])
            following = int.from_bytes(page[:4])
        return b"".join(parts), tuple(seen)


def header_at(number: int) -> int:
    """Where a page's own header begins."""
    return 100 if number == 1 else 0


def record(payload: bytes, length: int) -> list[Any] | None:
    """The values of a record of that length, as many as the payload has; None when it can be no record."""
    size, at = _varint(payload, 0)
    if size > len(payload) or size < at:
        return None
    types = []
    while at < size:
        kind, at = _varint(payload, at)
        types.append(kind)
    if at != size or size + sum(map(_width, types)) != length:
        return None
    values: list[Any] = []
    for kind in types:
        end = at + _width(kind)
        if end > len(payload):
            break
        values.append(_value(kind, payload[at:end]))
        at = end
    return values


_WIDTHS = (0, 1, 2, 3, 4, 6, 8, 8, 0, 0, 1 << 40, 1 << 40)  # 10 and 11 are never in a file
_CONSTANTS = {0: None, 8: 0, 9: 1}


def _width(kind: int) -> int:
    return _WIDTHS[kind] if kind < 12 else (kind - 12) >> 1


def _value(kind: int, content: bytes) -> Any:
    if kind >= 12:
        return decoded(content) if kind & 1 else content
    if kind in _CONSTANTS:
        return _CONSTANTS[kind]
    if kind == 7:
        return struct.unpack(">d", content)[0]
    return int.from_bytes(content, signed=True)


def _varint(content: Buffer, at: int) -> tuple[int, int]:
    byte = content[at]
    if byte < 0x80:
        return byte, at + 1
    value = 0
    for i in range(8):
        byte = content[at + i]
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, at + i + 1
    return value << 8 | content[at + 8], at + 9
