"""Roles, and the one place that says which role a request needs."""

from __future__ import annotations

import re
from enum import StrEnum
from typing import Any

OPEN_PATHS = frozenset({"/healthz", "/readyz"})
"""These answer without a token."""

STOP = ("POST", "/v1/robot/stop")
"""Whoever may look may stop; a stop is never refused for coming too often."""

_READING = frozenset({"GET", "HEAD", "OPTIONS"})
_ADMIN = re.compile(r"/v1/(tokens|backup|restore)(/.*)?", re.DOTALL)
_QUERY = re.compile(r"/v1/modules/[^/]+/query")
_BATCH = re.compile(r"/v1/modules/[^/]+/(samples|query)")
_ARCHIVES = frozenset({"/v1/restore", "/v1/modules/import"})


class Role(StrEnum):
    """What the holder of a token may do; each may do what those before it may."""

    VIEWER = "viewer"
    """Read, ask modules, stop the robot."""
    OPERATOR = "operator"
    """Teach, train, run, move."""
    ADMIN = "admin"
    """Tokens, backup, restore."""

    def covers(self, needed: Role) -> bool:
        """Whether this role may do what `needed` may."""
        return _RANK[self] >= _RANK[needed]


_RANK = {role: rank for rank, role in enumerate(Role)}


def needed_role(method: str, path: str) -> Role | None:
    """The role that a request needs; None: it needs no token.

    What is not mentioned here is reading, which every role may, or writing, which takes an operator.
    """
    if path in OPEN_PATHS:
        return None
    if _ADMIN.fullmatch(path):
        return Role.ADMIN
    if method in _READING or (method, path) == STOP:
        return Role.VIEWER
    if method == "POST" and _QUERY.fullmatch(path):
        return Role.VIEWER
    return Role.OPERATOR


def body_limit(path: str) -> str:
    """The name of the limit (`LimitSettings`) on a body: archives, samples and queries, and all others differ."""
    if path in _ARCHIVES:
        return "archive_bytes"
    return "batch_bytes" if _BATCH.fullmatch(path) else "body_bytes"


def describe(schema: dict[str, Any]) -> None:
    """Tells the role of every operation of an OpenAPI document: `x-role`, or no security where no token is asked."""
    for path, operations in schema["paths"].items():
        for method, operation in operations.items():
            role = needed_role(method.upper(), path)
            if role is None:
                operation["security"] = []
            else:
                operation["x-role"] = role.value
