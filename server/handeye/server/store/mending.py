"""Puts a row right of which one byte has changed: its CRC-32 says which one.

A CRC is linear. What a changed byte does to it depends on the change and on how many bytes come after, and not on the
row, so that the difference between the stored and the computed sum can be followed back through the row until it is
what one byte could have done.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from itertools import accumulate
from typing import Any

from sqlalchemy import Table

from handeye.server.store.reading import damage
from handeye.server.store.rows import encoded, kind_of

_CHANCE = 1e-3
"""Other damage may look like one changed byte this often; where it would more often, only a changed bit counts."""

_POLYNOMIAL = 0xEDB88320


def _effect(byte: int) -> int:
    for _ in range(8):
        byte = (byte >> 1) ^ (_POLYNOMIAL if byte & 1 else 0)
    return byte


_EFFECTS = [_effect(byte) for byte in range(256)]
_ERRORS = {effect: byte for byte, effect in enumerate(_EFFECTS) if byte}
_BY_HIGH_BYTE = {effect >> 24: byte for byte, effect in enumerate(_EFFECTS)}


def mended(table: Table, row: Mapping[str, Any]) -> dict[str, Any] | None:
    """The row as it was before one byte of it changed; None when more did, or when that cannot be told."""
    if type(row["checksum"]) is not int:
        return None
    try:
        pieces = [_bytes_of(row[name]) for name in table.columns.keys()[:-1]]
    except (TypeError, ValueError, struct.error):
        return None
    content = b"".join(pieces)
    computed = zlib.crc32(content)
    difference = (row["checksum"] ^ computed) & 0xFFFFFFFF
    if sum(byte != 0 for byte in difference.to_bytes(4)) <= 1:
        # It was the checksum itself.
        better = {**row, "checksum": computed}
        return better if damage(table, better) is None else None
    found = [*_with_another_byte(table, row, pieces, difference), *_with_another_sign(table, row)]
    return found[0] if len(found) == 1 else None


def _with_another_byte(
    table: Table, row: Mapping[str, Any], pieces: list[bytes], difference: int
) -> Iterator[dict[str, Any]]:
    """Rows that fit with one byte of `pieces`, what the checksum is made of, changed."""
    columns, ends = list(table.columns), list(accumulate(map(len, pieces)))
    for place, error in _places(difference, ends[-1]):
        which = next(i for i, end in enumerate(ends) if place < end)
        piece = bytearray(pieces[which])
        piece[place - ends[which]] ^= error
        with suppress(ValueError, struct.error):
            yield from _if_it_fits(table, row, columns[which].name, _decoded(bytes(piece), kind_of(columns[which])))


def _with_another_sign(table: Table, row: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Rows that fit with the first byte of a whole number changed, of the few that SQLite keeps: it has the sign."""
    for column in list(table.columns)[:-1]:
        value = row[column.name]
        for bits in (8, 16, 24, 32, 48) if type(value) is int and kind_of(column) is int else ():
            if -(1 << bits - 1) <= value < 1 << bits - 1:
                for change in range(0x80, 0x100):
                    other = (value ^ change << bits - 8) & (1 << bits) - 1
                    other -= (other >> bits - 1) << bits
                    yield from _if_it_fits(table, row, column.name, other)


def _if_it_fits(table: Table, row: Mapping[str, Any], name: str, value: Any) -> Iterator[dict[str, Any]]:
    better = {**row, name: value}
    if damage(table, better) is None:
        yield better


def _places(difference: int, length: int) -> Iterator[tuple[int, int]]:
    """(place, change) of every byte that alone could have made this difference of the checksum."""
    bytes_count, bits_count = length * 255 / 2**32 < _CHANCE, length * 8 / 2**32 < _CHANCE
    if not bits_count:
        return
    for place in range(length - 1, -1, -1):
        error = _ERRORS.get(difference)
        if error is not None and (bytes_count or error.bit_count() == 1):
            yield place, error
        byte = _BY_HIGH_BYTE[difference >> 24]
        difference = ((difference ^ _EFFECTS[byte]) << 8) & 0xFFFFFFFF | byte


def _bytes_of(value: object) -> bytes:
    """What the checksum is made of; text that is no UTF-8 any more too."""
    if isinstance(value, str):
        content = value.encode("utf-8", "surrogateescape")
        return struct.pack("<cq", b"s", len(content)) + content
    return encoded(value)


def _decoded(piece: bytes, kind: type) -> Any:
    """The value that `_bytes_of` makes this of; `ValueError` when none does."""
    tag, content = piece[:1], piece[1:]
    if tag == b"\x00" and not content:
        return None
    if kind is bool and tag in (b"\x01", b"\x02") and not content:
        return tag == b"\x02"
    if kind is int and tag == b"i":
        return struct.unpack("<q", content)[0]
    if kind is float and tag == b"f":
        return struct.unpack("<d", content)[0]
    if kind in (str, bytes) and tag == (b"s" if kind is str else b"b"):
        length, content = struct.unpack("<q", content[:8])[0], content[8:]
        if length == len(content):
            return content.decode() if kind is str else content
    raise ValueError(f"no {kind.__name__}")
