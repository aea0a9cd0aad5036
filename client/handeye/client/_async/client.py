"""The client: all of its parts, and whether the coordinator is ready."""

from __future__ import annotations

import httpx2

from handeye.client._async.admin import AsyncAdminCalls
from handeye.client._async.control import AsyncControl
from handeye.client._async.coordination import AsyncCoordinationCalls
from handeye.client._async.modules import AsyncModuleCalls
from handeye.client._async.robot import AsyncRobotCalls
from handeye.client._async.teaching import AsyncTeachingCalls
from handeye.client._retries import Deadline
from handeye.client._waiting import async_sleep
from handeye.client.errors import ApiError, TimedOut, Unreachable

_READY_POLL = 0.1
"""s between two questions whether the coordinator is ready."""


class AsyncClient(AsyncModuleCalls, AsyncTeachingCalls, AsyncRobotCalls, AsyncCoordinationCalls, AsyncAdminCalls):
    """A connection to a coordinator at `url` with its bearer `token`, to be used in a `with` block.

    Every method raises `ApiError` when the coordinator refuses and `Unreachable` when it does not answer; what is done
    only once however often it is asked for is asked for again before that. `timeout` s bound each call with its
    repetitions, and a network that falls silent in the midst of an answer may take as much again. `transport` replaces
    the network, for tests; `retries` say how patient to be.
    """

    async def not_ready(self) -> str | None:
        """Why the coordinator cannot work yet; None when it can."""
        try:
            await self._call("GET", "/readyz")
        except ApiError as error:
            if error.status == httpx2.codes.SERVICE_UNAVAILABLE:
                return error.detail
            raise
        return None

    async def wait_ready(self, timeout: float) -> None:
        """Returns once the coordinator is ready; `TimedOut` after `timeout` s says what is missing."""
        deadline = Deadline(timeout)
        while True:
            try:
                missing = await self.not_ready()
            except Unreachable as error:
                missing = str(error)
            if missing is None:
                return
            if deadline.passed():
                raise TimedOut(f"The coordinator was not ready within {timeout:g} s. {missing}")
            await async_sleep(_READY_POLL)

    def control(self, holder: str, motion_timeout: float = 300.0) -> AsyncControl:
        """Control of the robot under the name `holder`, for a `with` block; `ApiError` "busy" while another has it.

        `motion_timeout`: s after which a motion is given up and braked.
        """
        return AsyncControl(self, holder, motion_timeout)
