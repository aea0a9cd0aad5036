"""Prints the OpenAPI document: `make openapi` writes it to docs/openapi.json."""

from __future__ import annotations

import json
import sys

from handeye.server.app import routes_only


def document() -> str:
    """The document as JSON text, in an order that does not change by itself."""
    return json.dumps(routes_only().openapi(), indent=2, sort_keys=True, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    sys.stdout.write(document())
