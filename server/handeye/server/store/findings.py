"""What can be wrong in a store, what was done about it, and rows as they are set aside."""

from __future__ import annotations

import base64
import math
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from handeye.server.store.rows import dumps, now, seal
from handeye.server.store.tables import set_aside


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is wrong in a store."""

    table: str
    """"" when it concerns the store as a whole."""
    key: str
    """The row's primary key, its columns with slashes between them; "" when it concerns more than a row."""
    problem: str
    """A sentence without its full stop."""

    def __str__(self) -> str:
        return f"{' '.join(filter(None, (self.table, self.key))) or 'the store'}: {self.problem}"


@dataclass(frozen=True, slots=True)
class Repaired:
    """Something that was wrong, and what was done about it."""

    finding: Finding
    remedy: str
    """A sentence without its full stop."""


def shown(text: str) -> str:
    """Text that can be printed and stored anywhere: what is no character stands as its bytes."""
    return text.encode("utf-8", "backslashreplace").decode().replace("\x00", "\\x00")


def entry(table: str, key: str, reason: str, content: Mapping[str, Any]) -> dict[str, Any]:
    """A row for table `set_aside`; `content` is what could be read of the damaged one."""
    return seal(
        set_aside,
        {
            "id": secrets.token_hex(8),
            "of_table": table,
            "row_key": key,
            "reason": reason,
            "content": dumps({str(name): _written(value) for name, value in content.items()}),
            "found": now(),
        },
    )


def _written(value: Any) -> Any:
    """The value as JSON can say it: {"base64": …} for bytes and for text that is no UTF-8."""
    if isinstance(value, list):
        return [_written(each) for each in value]
    if isinstance(value, str):
        content = value.encode("utf-8", "surrogateescape")
        try:
            return content.decode()
        except UnicodeDecodeError:
            value = content
    if isinstance(value, bytes):
        return {"base64": base64.b64encode(value).decode()}
    if isinstance(value, float) and not math.isfinite(value):
        return {"float": repr(value)}
    return value
