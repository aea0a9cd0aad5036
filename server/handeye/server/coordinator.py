"""The coordinator: everything that the REST routes work on, wired together."""

from __future__ import annotations

import math
from collections.abc import Callable

from handeye.camera_bridge.driver import CameraDriver, StereoPair
from handeye.modules.recognition import NotSeen
from handeye.robot_bridge.driver import Pace, RobotState
from handeye.rpc.errors import Busy
from handeye.server.acting import ActingRobot, LeasedRobot
from handeye.server.demonstrations import Demonstrations, Observation
from handeye.server.executor import Run
from handeye.server.eyes import Eyes, Sight
from handeye.server.jobs import Job, Jobs
from handeye.server.objects import Kind, Objects, TaughtObject
from handeye.server.pictures import LookPictures
from handeye.server.settings import ServerSettings
from handeye.server.training import Tasks, TrainRequest, TrainStatistics


class Coordinator:
    """Objects, demonstrations, trained tasks and jobs, all in memory: none of it survives a restart.

    `missing` lists what cannot be reached, in sentences. Close it: jobs under way are cancelled and the arm is stopped.
    """

    def __init__(
        self,
        robot: LeasedRobot,
        cameras: CameraDriver,
        sight: Sight,
        settings: ServerSettings,
        missing: Callable[[], list[str]],
    ) -> None:
        self.robot = robot
        self.cameras = cameras
        self.settings = settings
        self.missing = missing
        self.eyes = Eyes(cameras, sight, settings.grab_timeout)
        self.objects = Objects(sight.learn)
        self.demonstrations = Demonstrations()
        self.tasks = Tasks()
        self.jobs = Jobs(settings.jobs_kept)
        self.pictures = LookPictures(settings.pictures_kept)

    def close(self) -> None:
        """Ends the jobs; the robot and the cameras stay their owner's to close."""
        self.jobs.close()

    def grab(self, not_older_than: float) -> StereoPair:
        """A stereo pair that shows the world at `not_older_than` (world time in s) or later."""
        return self.cameras.grab_stereo(not_older_than, self.settings.grab_timeout)

    def show_object(self, name: str, kind: Kind, not_older_than: float) -> TaughtObject:
        """Grabs a pair of the scene without or with the object, and learns the object from all pairs so far."""
        return self.objects.add(name, kind, self.grab(not_older_than))

    def observe(self, demonstration_id: str, subtask: str, *, goal: bool, key: bool) -> Observation:
        """Adds what is seen and read now to a demonstration.

        `Busy` while the arm moves, `NotSeen` when object or hand is not found in both pictures, `Conflict` when the
        demonstration cannot take the observation, `DeadlineExceeded` without a picture of the arm at rest.
        """
        demonstration = self.demonstrations.recordable(demonstration_id, subtask, goal=goal)
        state = self._resting_state()
        sighting = self.eyes.look(demonstration.object, state.still_since)
        if isinstance(sighting.found, NotSeen):
            raise sighting.found
        if self._resting_state().still_since != state.still_since:
            raise Busy("the arm moved while it was looked at; observe again once it stands still")
        return self.demonstrations.observe(
            demonstration_id, subtask, sighting.found, state.joints, sighting.world_time, goal=goal, key=key
        )

    def train(self, task: str, request: TrainRequest) -> TrainStatistics:
        """Builds the task's module from its finished demonstrations."""
        return self.tasks.train(task, self.demonstrations.finished(task), request)

    def run(self, task: str, object_name: str, *, one_look: bool) -> Job:
        """Starts a job that does a trained task; `JobBusy` while another acts."""
        skill = self.tasks.get(task)
        self.objects.require(object_name)
        acting = self.settings.acting

        def work(job: Job) -> None:
            robot = ActingRobot(self.robot, lambda _done: job.check(), Pace(acting.pace, acting.pace))
            with self.robot.lease():
                Run(
                    skill,
                    object_name,
                    robot,
                    self.eyes,
                    acting,
                    job,
                    lambda picture: self.pictures.add(job.id, picture),
                    one_look=one_look,
                ).execute()

        return self.jobs.start(task, object_name, work)

    def _resting_state(self) -> RobotState:
        state = self.robot.state()
        if state.moving or not math.isfinite(state.still_since):
            raise Busy("the arm is moving; observe once it stands still")
        return state
