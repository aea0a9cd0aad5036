"""Jobs that act with robot and head, under the control lease."""

from __future__ import annotations

import math
from collections.abc import Callable

from handeye.robot_bridge.driver import Pace, RobotState
from handeye.rpc.errors import Busy
from handeye.server.acting import ActingHead, ActingRobot, LeasedRobot
from handeye.server.album import Album
from handeye.server.control import Control
from handeye.server.eyes import Eyes
from handeye.server.job import Job, Kind
from handeye.server.jobs import Jobs
from handeye.server.looking import Looker
from handeye.server.settings import ServerSettings

Work = Callable[[Job, ActingRobot, Looker], None]
"""What a job does: it is given robot and eyes as an acting task may use them."""


class ActingJobs:
    """Starts them; at most one at a time acts."""

    def __init__(self, jobs: Jobs, robot: LeasedRobot, control: Control, eyes: Eyes, settings: ServerSettings) -> None:
        self.robot = robot
        self._jobs = jobs
        self._control = control
        self._eyes = eyes
        self._settings = settings

    def start(self, kind: Kind, subject: str, object_name: str | None, work: Work) -> Job:
        """Starts a job that acts under the control lease; `Busy` while another job or a person controls the robot."""
        self._control.require_free()
        acting = self._settings.acting

        def begin(job: Job) -> None:
            robot = ActingRobot(self.robot, lambda _done: job.check(), Pace(acting.pace, acting.pace))
            head = ActingHead(self._control.head, self.robot, job.check)
            with self.robot.lease():
                work(job, robot, Looker(robot, head, self._eyes, acting.settle, job.check))

        return self._jobs.start(kind, subject, object_name, begin, acts=True)

    def album(self, job: Job) -> Album:
        """For the pictures of a job's looks."""
        return Album(job.id, self._settings.pictures_kept)

    def resting_state(self) -> RobotState:
        """The robot's state; `Busy` unless the arm stands still."""
        state = self.robot.state()
        if state.moving or not math.isfinite(state.still_since):
            raise Busy("the arm is moving; observe once it stands still")
        return state
