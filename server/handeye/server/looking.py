"""Looking while acting: a pair of pictures that shows arm and head at rest, and the head's turns before it."""

from __future__ import annotations

from collections.abc import Callable

from handeye.camera_bridge.driver import Course, HeadState, StereoPair
from handeye.modules.spaces import HeadAngles
from handeye.robot_bridge.driver import RobotState
from handeye.server.acting import ActingHead, ActingRobot
from handeye.server.eyes import Eyes

_NEWER = 1e-3  # s: less than lies between any two pictures


class Looker:
    """The eyes of one acting job, and the head that carries them.

    `check` is called about every 20 ms while pictures are waited for; what it raises ends the wait.
    """

    def __init__(
        self, robot: ActingRobot, head: ActingHead, eyes: Eyes, settle: float, check: Callable[[], None]
    ) -> None:
        """`settle`: world time waited beyond the cameras' latency, in s."""
        self._robot = robot
        self._head = head
        self._eyes = eyes
        self._settle = settle
        self._check = check
        self._turned = 0.0
        """World time since when the head stands still, in s."""

    @property
    def head(self) -> HeadState:
        """Where the head points."""
        return self._head.state()

    def turn(self, to: HeadAngles) -> HeadState:
        """Turns the head; returns where it stands then. `OutOfLimits` beyond its range."""
        reached = self._head.turn(to)
        self._turned = reached.world_time
        return reached

    def look(self) -> tuple[RobotState, StereoPair]:
        """The robot's state at rest, and a pair that shows it with the head at rest too."""
        state = self._robot.at_rest()
        since = max(state.still_since, self._turned)
        ready = since + self._eyes.latency + self._settle
        if self._robot.lockstep and state.world_time < ready:
            # In lockstep nobody else lets the time pass that the cameras need.
            state = self._robot.wait(ready - state.world_time)
        return state, self._eyes.grab(since, self._keep_alive)

    def glance(self, newer_than: float | None, period: float) -> StereoPair:
        """The newest pair, arm and head moving or not; it shows the world after `newer_than` (world time in s).

        In lockstep `period` s of world time pass before.
        """
        if self._robot.lockstep:
            self._robot.wait(period)
        return self._eyes.grab(0.0 if newer_than is None else newer_than + _NEWER, self._keep_alive)

    def follow(self, course: Course, lasting: float) -> HeadState:
        """Lets the head follow a course for at most `lasting` s; returns at once with where it points now."""
        return self._head.follow(course, lasting)

    def halt(self) -> None:
        """Ends following: the head slows down and stands still."""
        self._head.halt()

    def _keep_alive(self) -> None:
        """The control lease is kept while pictures are waited for."""
        self._robot.beat()
        self._check()
