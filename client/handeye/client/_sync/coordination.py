# Made by tools/make_sync.py from client/handeye/client/_async/coordination.py: change that, then `make sync`.
"""Hand and eye as a whole: reaching for what is seen, turning the head to it, collecting samples for both."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from numpy.typing import ArrayLike

from handeye.client._arrays import rows_of_points
from handeye.client._job_models import CollectJob, CollectResult, GazeJob, OnEvent, Point, PursuitJob, ReachJob, Seen
from handeye.client._sync.jobs import SyncJobCalls, ignore

Keep = Literal["all", "first", "last"]
Babbler = Literal["AJS", "CAS", "IJS"]


class SyncCoordinationCalls(SyncJobCalls):
    """The part of the client for /v1/reaches, /v1/gazes, /v1/pursuits and /v1/collect.

    Jobs are waited for `timeout` s; they are returned when they have ended, failed ones too.
    """

    def look(self, object_name: str | None = None, not_older_than: float = 0.0) -> Seen:
        """Where an object, or the hand for None, is seen now; `ApiError` "not_seen" when it is not.

        The pictures show the world at `not_older_than` (world time, s) or later.
        """
        wanted = {"object": object_name, "not_older_than": not_older_than}
        return self._post(Seen, "/v1/looks", wanted, retries=self._retries)

    def reach(
        self,
        target: str | Point,
        *,
        one_look: bool = False,
        gaze: bool = False,
        timeout: float = 120.0,
        on_event: OnEvent = ignore,
    ) -> ReachJob:
        """Brings the hand to an object, or to a point (row, column, disparity) in px of the picture as it is now.

        With `gaze` the head turns to the object before.
        """
        wanted = {"object": target} if isinstance(target, str) else {"point": list(target)}
        job = self._post_once(ReachJob, "/v1/reaches", {**wanted, "one_look": one_look, "gaze": gaze})
        return self._see_through(job, timeout, on_event)

    def gaze(self, object_name: str | None = None, *, timeout: float = 120.0, on_event: OnEvent = ignore) -> GazeJob:
        """Turns the head until an object, or the hand for None, is in the middle of the left picture."""
        job = self._post_once(GazeJob, "/v1/gazes", {"object": object_name})
        return self._see_through(job, timeout, on_event)

    def pursue(
        self, object_name: str, duration: float, *, timeout: float = 300.0, on_event: OnEvent = ignore
    ) -> PursuitJob:
        """Follows an object that moves with the head, for `duration` s of world time or until it is lost."""
        job = self._post_once(PursuitJob, "/v1/pursuits", {"object": object_name, "duration": duration})
        return self._see_through(job, timeout, on_event)

    def collect_fixation(
        self, object_name: str, *, keep: Keep = "all", timeout: float = 120.0, on_event: OnEvent = ignore
    ) -> CollectJob:
        """Has SCS learn from a resting object that the head is turned to; `keep` says from which looks."""
        job = self._post_once(CollectJob, "/v1/collect/fixations", {"object": object_name, "keep": keep})
        return self._see_through(job, timeout, on_event)

    def collect_postures(
        self,
        modules: Sequence[Babbler],
        *,
        postures: int = 300,
        looks: int = 3,
        lower: Point | None = None,
        upper: Point | None = None,
        synergies: Sequence[Sequence[float]] | None = None,
        seed: int = 1,
        timeout: float = 3600.0,
        on_event: OnEvent = ignore,
    ) -> CollectJob:
        """Has the arm babble and modules learn, until there are so many postures, those of earlier times included.

        `lower` and `upper` are corners of the region in m, world frame; `synergies` the directions in joint space along
        which the arm moves; None: the coordinator's own.
        """
        body: dict[str, object] = {"modules": list(modules), "postures": postures, "looks": looks, "seed": seed}
        given = {"lower": lower, "upper": upper, "synergies": synergies}
        body |= {name: value for name, value in given.items() if value is not None}
        job = self._post_once(CollectJob, "/v1/collect/postures", body)
        return self._see_through(job, timeout, on_event)

    def collect_grid_view(self, points: ArrayLike, *, every: int = 1, not_older_than: float = 0.0) -> CollectResult:
        """Has CSS learn from a grid whose intersections are at `points` (rows, columns, 3), m, left camera's frame.

        Row by row as the camera sees them, the first one at the upper left; only `every` so manyth row and column is
        learned. The pictures show the world at `not_older_than` (world time, s) or later.
        """
        body = {"points": rows_of_points(points), "every": every, "not_older_than": not_older_than}
        return self._post_once(CollectResult, "/v1/collect/grid-views", body)
