"""How much, how often, and how many guesses: the bounds that keep one caller from harming the others."""

from __future__ import annotations

import ipaddress
import math
from collections import OrderedDict

from pydantic import BaseModel, ConfigDict, Field

WINDOW = 10.0
"""Seconds over which wrong tokens are counted."""
HEAD_BYTES = 64 * 1024
"""What path, query and headers of a request may have together."""
_ADDRESSES = 4096  # that are counted at a time; the oldest are forgotten first


class LimitSettings(BaseModel):
    """What a caller may ask for, from HANDEYE_SERVER_LIMITS__*."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    body_bytes: int = Field(default=2**20, ge=1024)
    """Size of a request's body. None but the two below needs much, and JSON takes a hundred times its size to read."""
    batch_bytes: int = Field(default=32 * 2**20, ge=1024)
    """The same for samples and queries."""
    archive_bytes: int = Field(default=2**30, ge=1024)
    """The same for a module or a store that is read back: POST /v1/modules/import and /v1/restore."""
    requests_per_second: float = Field(default=5000.0, gt=0.0, allow_inf_nan=False)
    """Requests of one token per second; one second's may come at once."""
    wrong_tokens: int = Field(default=20, ge=1)
    """Wrong tokens from one address in 10 s; after that only tokens that this address has used before are looked at."""


class Bucket:
    """A token bucket: `rate` requests a second, one second's at once (one at least)."""

    __slots__ = ("_at", "_left", "_most", "_rate")

    def __init__(self, rate: float, now: float) -> None:
        self._rate = rate
        self._most = max(rate, 1.0)
        self._left = self._most
        self._at = now

    def take(self, now: float) -> float:
        """Takes one at time `now` (s); returns 0, or the seconds until there is one."""
        left = self._left + (now - self._at) * self._rate
        self._at = now
        if left > self._most:
            left = self._most
        if left >= 1.0:
            self._left = left - 1.0
            return 0.0
        self._left = left
        return (1.0 - left) / self._rate


class WrongTokens:
    """Counts wrong tokens by the address that they come from, so that guessing is slow."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._counts: OrderedDict[str, tuple[float, int]] = OrderedDict()
        """By address: when its count began, and the count."""

    def wait(self, address: str, now: float) -> int:
        """Whole seconds until `address` may guess again; 0 when it may now."""
        if not self._counts:
            return 0
        began, count = self._counts.get(_group(address), (-math.inf, 0))
        return math.ceil(began + WINDOW - now) if count >= self._most and now < began + WINDOW else 0

    def note(self, address: str, now: float) -> None:
        """One more wrong token from `address`."""
        group = _group(address)
        began, count = self._counts.pop(group, (now, 0))
        if now >= began + WINDOW:
            began, count = now, 0
        self._counts[group] = began, count + 1
        while len(self._counts) > _ADDRESSES:
            self._counts.popitem(last=False)


def _group(address: str) -> str:
    """The address; of IPv6 the /64, which one machine has to itself."""
    if ":" not in address:
        return address
    try:
        return str(ipaddress.IPv6Interface(f"{address.partition('%')[0]}/64").network)
    except ValueError:
        return address


def size(count: int) -> str:
    """A number of bytes for people: `32 MiB`."""
    for unit, name in ((2**30, "GiB"), (2**20, "MiB"), (2**10, "KiB")):
        if count >= unit:
            return f"{count / unit:.4g} {name}"
    return f"{count} bytes"
