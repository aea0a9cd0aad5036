# Made by tools/make_sync.py from client/handeye/client/_async/robot.py: change that, then `make sync`.
"""The robot, the head and the cameras."""

from __future__ import annotations

from collections.abc import Generator
from typing import Literal

from handeye.client._arrays import NPY, Image, decode_image
from handeye.client._foreign import Answer, readable
from handeye.client._multipart import Parts, boundary_of
from handeye.client._retries import URGENT
from handeye.client._robot_models import HeadDescription, Robot, RobotDescription
from handeye.client._sync.jobs import SyncJobCalls

Camera = Literal["left", "right", "observer"]

_PICTURES_LATE = 10.0
"""s by which a picture of a stream may be late."""
_SLOWEST = 0.01
"""Pictures per s of the slowest stream."""


class SyncRobotCalls(SyncJobCalls):
    """The part of the client for /v1/robot (but for control, see `control`), /v1/head and /v1/cameras."""

    def robot(self) -> Robot:
        """The robot's state."""
        return self._get(Robot, "/v1/robot")

    def robot_description(self) -> RobotDescription:
        """What the robot is."""
        return self._get(RobotDescription, "/v1/robot/description")

    def stop_robot(self, reason: str = "a client asked for it") -> Robot:
        """Brakes a motion under way and latches the software stop. Not safety-rated.

        It is asked for again, quickly, until the coordinator says that it is done. An error means that the arm may
        not be stopped.
        """
        # Without a key: a remembered answer would say "stopped" of an arm that was reset since.
        return self._post(Robot, "/v1/robot/stop", {"reason": reason}, retries=URGENT)

    def reset_robot(self) -> Robot:
        """Clears the software stop. Asked for once only: a repeated reset could clear another, later stop."""
        return self._post(Robot, "/v1/robot/reset")

    def head(self) -> HeadDescription:
        """Where the head points, and how far it turns."""
        return self._get(HeadDescription, "/v1/head")

    # Pictures

    def frame(self, camera: Camera, not_older_than: float = 0.0) -> bytes:
        """A camera's picture as JPEG, showing the world at `not_older_than` (world time, s) or later."""
        return (self._frame(camera, "image/jpeg", not_older_than)).content

    def frame_png(self, camera: Camera, not_older_than: float = 0.0) -> bytes:
        """The same as PNG: no pixel is changed."""
        return (self._frame(camera, "image/png", not_older_than)).content

    def image(self, camera: Camera, not_older_than: float = 0.0) -> Image:
        """The same as an array, with the world time that it shows."""
        answer = self._frame(camera, NPY, not_older_than)
        with readable(self._url):
            return Image(decode_image(answer.content), float(answer.headers.get("world-time", "nan")))

    def _frame(self, camera: Camera, media_type: str, not_older_than: float) -> Answer:
        return self._call(
            "GET",
            f"/v1/cameras/{camera}/frame",
            params={"not_older_than": str(not_older_than)},
            headers={"Accept": media_type},
            retries=self._retries,
        )

    def frames(self, camera: Camera, rate: float = 5.0) -> Generator[bytes]:
        """A camera's pictures as JPEGs, up to `rate` per s, until you stop asking or the coordinator ends."""
        silence = _PICTURES_LATE + 1.0 / max(rate, _SLOWEST)
        with self._stream(
            "GET", f"/v1/cameras/{camera}/stream", silence=silence, params={"rate": str(rate)}
        ) as response:
            with readable(self._url):
                parts = Parts(boundary_of(response.headers.get("content-type", "")))
            for data in response.iter_bytes():
                with readable(self._url):
                    complete = list(parts.feed(data))
                yield from complete

    def picture(self, path: str) -> bytes:
        """The JPEG at `path`, such as `Look.picture`."""
        return (self._call("GET", path, retries=self._retries)).content
