# Made by tools/make_sync.py from client/handeye/client/_async/control.py: change that, then `make sync`.
"""Control of the robot: a lease that is kept alive, and motions under it."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from types import TracebackType
from typing import Self

import httpx2
from numpy.typing import ArrayLike

from handeye.client._arrays import vector
from handeye.client._job_models import MotionJob
from handeye.client._robot_models import Head, Lease, Robot
from handeye.client._sync.robot import SyncRobotCalls
from handeye.client._waiting import SyncBeats
from handeye.client.errors import ApiError, HandeyeError, LeaseLost, UnexpectedAnswer, Unreachable

BEAT_PERIOD = 0.5
"""s between two signs of life."""
BEAT_TIMEOUT = 1.0
"""s after which a sign of life that was not answered counts as lost, and another one is sent."""
BEAT_LEAST = 0.1
"""s that the last one gets."""
GIVE_BACK_TIMEOUT = 8.0
"""s to give control back: what moves is braked first."""
START_TIMEOUT = 5.0
"""s within which a motion must begin: one that comes later is not what was wanted."""
MOTION_SILENCE = 1.0
"""s of silence after which a motion is asked after, and whether control is still ours."""


class Control:
    """Control of the robot while the `with` block lasts; made by the client's `control`.

    The lease's sign of life is sent in the background. Motions return the state that was *reached*. Joints are in rad,
    base to wrist, points in m, world frame; `speed` and `acceleration` are shares in [0.001, 1] of the limits, and the
    coordinator has its own when they are None. When a motion is left early (Ctrl-C, an error, its deadline), its job is
    cancelled and the arm brakes.

    Every method raises `LeaseLost` once control is lost, `JobFailed` when a motion did not succeed, and `ApiError` when
    it is refused, as all motions are while the software stop is latched. Not safety-rated.
    """

    def __init__(self, client: SyncRobotCalls, holder: str, motion_timeout: float) -> None:
        self._client = client
        self._holder = holder
        self._timeout = motion_timeout
        self._lease = Lease(lease="", holder=holder, expires_after=0.0)
        self._beats = SyncBeats(self._beat, BEAT_PERIOD)
        self._heard = 0.0  # when the newest sign of life that was answered had been sent
        self._lost = ""

    def __enter__(self) -> Self:
        self._heard, self._lost = time.monotonic(), ""
        # Once and without a key: a lease whose answer was lost ends by itself.
        self._lease = self._client._post(Lease, "/v1/robot/lease", {"holder": self._holder})
        self._beats = SyncBeats(self._beat, BEAT_PERIOD)
        try:
            self._beats.start()
        except BaseException:
            self._give_back()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._beats.stop()
        finally:
            self._give_back()
        if error is None:
            self._check()

    # What the arm does

    def state(self) -> Robot:
        """The robot's state."""
        self._check()
        return self._client.robot()

    def park(self, speed: float | None = None, acceleration: float | None = None) -> Robot:
        """Moves to the park position."""
        return self._move("park", _pace(speed, acceleration))

    def open_gripper(self) -> Robot:
        """Opens the gripper fully."""
        return self._move("open_gripper", {})

    def close_gripper(self) -> Robot:
        """Closes the gripper until the fingers meet something or each other."""
        return self._move("close_gripper", {})

    def move_to_point(self, point: ArrayLike, speed: float | None = None, acceleration: float | None = None) -> Robot:
        """Moves the tool centre point to `point` (3,), keeping the tool's orientation."""
        return self._move("move_to_point", {"point": vector(point, "a point"), **_pace(speed, acceleration)})

    def move_to_joints(self, joints: ArrayLike, speed: float | None = None, acceleration: float | None = None) -> Robot:
        """Moves to `joints`."""
        return self._move("move_to_joints", {"joints": vector(joints, "joints"), **_pace(speed, acceleration)})

    def adjust_joints(self, delta: ArrayLike, speed: float | None = None, acceleration: float | None = None) -> Robot:
        """Changes the joints by `delta`."""
        return self._move("adjust_joints", {"delta": vector(delta, "a delta"), **_pace(speed, acceleration)})

    def advance(self, duration: float) -> Robot:
        """Lets `duration` s of world time pass while the arm holds still."""
        return self._move("advance", {"duration": duration})

    # What the head does

    def turn_head(self, pan: float, tilt: float) -> Head:
        """Turns the head to `pan` (positive to its left) and `tilt` (positive up), in rad."""
        reached = self._do("/v1/head/moves", {"pan": pan, "tilt": tilt})
        if not isinstance(reached, Head):
            raise UnexpectedAnswer("A move of the head has ended without saying where the head is.")
        return reached

    # How all of it is done

    def _move(self, action: str, body: Mapping[str, object]) -> Robot:
        reached = self._do(f"/v1/robot/actions/{action}", body)
        if not isinstance(reached, Robot):
            raise UnexpectedAnswer(f"The motion '{action}' has ended without saying where the arm is.")
        return reached

    def _do(self, path: str, body: Mapping[str, object]) -> Robot | Head | None:
        self._check()
        try:
            job = self._client._post_once(MotionJob, path, body, headers=self._headers, timeout=START_TIMEOUT)
        except ApiError as error:
            self._lose_by(error)
            self._check()
            raise
        ended = self._client._see_through(job, self._timeout, silence=MOTION_SILENCE, check=self._check)
        if not ended.succeeded:
            self._check()  # why it did not
        return ended.raise_for_failure().result

    @property
    def _headers(self) -> dict[str, str]:
        return {"Control-Lease": self._lease.lease}

    def _beat(self) -> bool:
        """One sign of life; False when there is nothing left to keep alive."""
        sent = time.monotonic()
        left = self._heard + self._lease.expires_after - sent
        limit = min(max(left, BEAT_LEAST), BEAT_TIMEOUT)
        try:
            self._client._call("PUT", "/v1/robot/lease", headers=self._headers, timeout=limit)
        except (ApiError, Unreachable) as error:
            self._lose_by(error)
            reason = str(error)
        except Exception as error:
            # Whatever it is, nothing keeps the lease alive any more; the holder has to know.
            self._lost = f"No sign of life can be sent: {error}"
            return False
        else:
            self._heard = sent
            return True
        if time.monotonic() - self._heard >= self._lease.expires_after:
            self._lost = reason
        return not self._lost

    def _lose_by(self, error: HandeyeError) -> None:
        """Control is lost when the coordinator says so, not when it is in trouble."""
        if isinstance(error, ApiError) and error.code == "lease_needed":
            self._lost = "No sign of life came in time, or the coordinator was started anew."
        elif isinstance(error, ApiError) and error.status in (httpx2.codes.UNAUTHORIZED, httpx2.codes.FORBIDDEN):
            self._lost = error.detail

    def _check(self) -> None:
        if self._lost:
            raise LeaseLost(f"'{self._holder}' has lost control of the robot. {self._lost}")

    def _give_back(self) -> None:
        with suppress(HandeyeError):  # it ends by itself when it cannot be given back
            self._client._call("DELETE", "/v1/robot/lease", headers=self._headers, timeout=GIVE_BACK_TIMEOUT)


def _pace(speed: float | None, acceleration: float | None) -> dict[str, object]:
    given = {"speed": speed, "acceleration": acceleration}
    pace = {name: value for name, value in given.items() if value is not None}
    return {"pace": pace} if pace else {}
