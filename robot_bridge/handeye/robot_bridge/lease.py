"""The control lease: one controller at a time may move the robot, and only while it shows that it is alive."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from handeye.rpc.errors import Busy, InvalidArgument, Unauthorised

HEARTBEAT_PERIOD = 0.02
"""A holder that moves the robot sends a heartbeat every so many seconds."""
SILENCE_LIMIT = 0.1
"""Without a heartbeat for so many seconds a moving arm brakes (realtime) or the world stands still (lockstep)."""
LOCKSTEP_PATIENCE = 1.0
"""In lockstep the motion is given up after so many seconds of silence."""
TAKEOVER_AFTER = 2.0
"""A lease that has been silent for so many seconds, with no motion under way, may be taken over."""


def lease_digest(lease_id: str) -> str:
    """What heartbeats carry: SHA-256 of the lease, in hex. All on the bus hear it, and none can move by it."""
    return hashlib.sha256(lease_id.encode()).hexdigest()


@dataclass(slots=True)
class _Lease:
    """A lease that was given out: its secret and that one's digest, whose it is, when it was last heard of."""

    lease_id: str
    digest: str
    holder: str
    heard: float
    motions: int = 0


class LeaseKeeper:
    """Gives out the control lease and listens for its holder. Thread-safe.

    Lease ids are secrets: they are compared in constant time and appear in no error, no stream and no log.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lease: _Lease | None = None
        self._changed = threading.Condition()

    @property
    def holder(self) -> str:
        """Who holds the lease; empty when nobody does."""
        with self._changed:
            return self._lease.holder if self._lease is not None else ""

    def acquire(self, holder: str) -> str:
        """Gives `holder` the lease and returns its id; `Busy` while another one is alive."""
        if not holder.strip():
            raise InvalidArgument("the holder of a lease needs a name")
        with self._changed:
            lease = self._lease
            if lease is not None:
                silence = self._clock() - lease.heard
                if lease.motions or silence < TAKEOVER_AFTER:
                    raise Busy(
                        f"{lease.holder!r} holds the control lease and was heard of {silence:.2f} s ago; "
                        f"it can be taken over after {TAKEOVER_AFTER:g} s of silence",
                        detail=lease.holder,
                    )
            lease_id = secrets.token_hex(16)
            self._lease = _Lease(lease_id, lease_digest(lease_id), holder, self._clock())
            self._changed.notify_all()
            return lease_id

    def release(self, lease_id: str) -> None:
        """Takes the lease back; a motion under it finds out by `check`. `Unauthorised` when it is not the lease."""
        with self._changed:
            self._require(lease_id)
            self._lease = None
            self._changed.notify_all()

    def beat(self, digest: str) -> None:
        """Notes a heartbeat with a lease's digest; another lease's (its holder lost it) is ignored."""
        with self._changed:
            if self._lease is not None and _equal(self._lease.digest, digest):
                self._lease.heard = self._clock()
                self._changed.notify_all()

    def check(self, lease_id: str) -> None:
        """Raises `Unauthorised` unless `lease_id` is the lease."""
        with self._changed:
            self._require(lease_id)

    @contextmanager
    def in_use(self, lease_id: str) -> Iterator[None]:
        """A motion under the lease: its beginning counts as a heartbeat, and nobody takes the lease over meanwhile."""
        with self._changed:
            lease = self._require(lease_id)
            lease.heard = self._clock()
            lease.motions += 1
        try:
            yield
        finally:
            with self._changed:
                lease.motions -= 1

    def silence(self, lease_id: str) -> float:
        """Seconds since the holder was last heard of; `Unauthorised` when it is not the lease (any more)."""
        with self._changed:
            return self._clock() - self._require(lease_id).heard

    def wait(self, timeout: float) -> None:
        """Waits up to `timeout` s for a heartbeat or for the lease to change hands."""
        with self._changed:
            self._changed.wait(timeout)

    def _require(self, lease_id: str) -> _Lease:
        lease = self._lease
        if lease is not None and _equal(lease.lease_id, lease_id):
            return lease
        if lease is None:
            raise Unauthorised("this needs the control lease, which nobody holds now: acquire it first")
        raise Unauthorised(
            f"this needs the control lease, which {lease.holder!r} holds: acquire it when it is free",
            detail=lease.holder,
        )


def _equal(one: str, other: str) -> bool:
    return hmac.compare_digest(one.encode(), other.encode())
