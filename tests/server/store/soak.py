"""How often tests do what they do at random: `make soak` sets HANDEYE_SOAK=100, `make test` leaves it at 5."""

from __future__ import annotations

import os

KILLS = int(os.environ.get("HANDEYE_SOAK", "5"))
"""How many processes are killed in the midst of writing."""


def rounds(usual: int) -> int:
    """How many rounds of something else: `usual` of them in `make test`, in proportion."""
    return usual * KILLS // 5
