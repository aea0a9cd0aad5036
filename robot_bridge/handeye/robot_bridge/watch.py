"""What is looked at in every control step of a motion on the bus."""

from __future__ import annotations

import time
from collections.abc import Callable

from handeye.robot_bridge.lease import HEARTBEAT_PERIOD, SILENCE_LIMIT, LeaseKeeper
from handeye.rpc.errors import Stopped, Unauthorised

PROGRESS_PERIOD = 0.05
"""Least wall time in s between two progress reports."""


class LeaseWatch:
    """The `Watch` of one motion: is it interrupted, does the lease holder still live; and now and then a report.

    After 100 ms without a heartbeat it returns no more, so that in lockstep no further step is taken, until one comes
    or `patience` s of silence are over: then `Stopped`. In realtime time does not wait, so patience is 100 ms there.

    `interrupted` raises when the motion must end for another reason; `report` gets the share done, at most 20 times
    a second.
    """

    def __init__(
        self,
        leases: LeaseKeeper,
        lease_id: str,
        patience: float,
        interrupted: Callable[[], None],
        report: Callable[[float], None],
    ) -> None:
        self._leases = leases
        self._lease_id = lease_id
        self._holder = leases.holder
        self._patience = patience
        self._interrupted = interrupted
        self._report = report
        self._report_due = time.monotonic()

    def __call__(self, fraction: float) -> None:
        """One control step at `fraction` (0..1) of the motion; raises what must end it."""
        self._interrupted()
        while (silence := self._silence()) > SILENCE_LIMIT:
            if silence >= self._patience:
                raise Stopped(
                    f"the lease holder {self._holder!r} has been silent for {silence:.2f} s during a motion: the arm "
                    "was braked and the software stop is latched",
                    detail=self._holder,
                )
            self._leases.wait(HEARTBEAT_PERIOD)
            self._interrupted()
        now = time.monotonic()
        if now >= self._report_due:
            self._report_due = now + PROGRESS_PERIOD
            self._report(fraction)

    def _silence(self) -> float:
        try:
            return self._leases.silence(self._lease_id)
        except Unauthorised as error:
            raise Unauthorised(
                f"{self._holder!r} gave the control lease back during a motion: the arm was braked",
                detail=self._holder,
            ) from error
