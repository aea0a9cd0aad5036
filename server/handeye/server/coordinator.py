"""The coordinator: everything that the REST routes work on, wired together."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from pydantic import ValidationError

from handeye.camera_bridge.driver import CameraDriver, StereoPair
from handeye.modules.declaration import ApproximatorSettings
from handeye.modules.recognition import NotSeen
from handeye.modules.spaces import HeadAngles, ImagePoint
from handeye.robot_bridge.driver import RobotState
from handeye.rpc.errors import Busy
from handeye.server.acting import ActingRobot, LeasedRobot
from handeye.server.acting_jobs import ActingJobs
from handeye.server.control import Control
from handeye.server.coordination import Coordination
from handeye.server.demonstration import Observation
from handeye.server.demonstrations import Demonstrations
from handeye.server.executor import Run
from handeye.server.eyes import Eyes, Sight, Sighting
from handeye.server.felt import FeltHand
from handeye.server.job import Job
from handeye.server.jobs import Jobs
from handeye.server.livemodules import LiveModules
from handeye.server.looking import Looker
from handeye.server.objects import Kind as PictureKind
from handeye.server.objects import Objects, TaughtObject
from handeye.server.problem import Invalid
from handeye.server.results import ModuleStatistics
from handeye.server.settings import ServerSettings
from handeye.server.statistics import module_statistics
from handeye.server.store import Store
from handeye.server.store.backup import restore
from handeye.server.training import Tasks, TrainRequest

_ENDING = 2.0  # s that a job which was cancelled may take to end


class Coordinator:
    """Modules, objects, demonstrations, tasks and jobs of a store, and the robot and the cameras that they are about.

    `missing` lists what cannot be reached, in sentences. Close it: jobs under way are cancelled and the arm is stopped.
    """

    def __init__(
        self,
        store: Store,
        robot: LeasedRobot,
        control: Control,
        cameras: CameraDriver,
        sight: Sight,
        settings: ServerSettings,
        missing: Callable[[], list[str]],
        on_job_end: Callable[[Job], None] = lambda _job: None,
    ) -> None:
        self.store = store
        self.robot = robot
        self.control = control
        self.cameras = cameras
        self.settings = settings
        self.missing = missing
        self.eyes = Eyes(cameras, sight, settings.grab_timeout)
        self.modules = LiveModules(store)
        self.objects = Objects(store, sight.learn, sight.forget)
        self.demonstrations = Demonstrations(store)
        self.tasks = Tasks(store, self.modules)
        self.jobs = Jobs(store, settings.jobs_kept, on_job_end)
        self.acting = ActingJobs(self.jobs, robot, control, self.eyes, settings)
        self.coordination = Coordination(self.acting, self.modules, self.objects, self.eyes, settings)
        self.closing = threading.Event()
        """Set when the coordinator ends: what goes on and on ends then."""

    def load(self, progress: Callable[[str], None] = lambda _sentence: None) -> None:
        """Rebuilds from the store what answers: modules and objects. `progress` is told what is under way."""
        self.modules.load(lambda share: progress(f"modules are being built from the store ({share:.0%})"))
        for taught in self.objects.all():
            progress(f"object '{taught.name}' is being learned from its pictures")
            self.objects.restore(taught.name)

    def restore(self, path: Path) -> None:
        """Puts a backup in the place of everything but the tokens, all or nothing, and answers by it.

        `Busy` while a job is under way or somebody has control; otherwise raises as `store.backup.restore` does.
        """
        with self.store.write():  # meanwhile nobody starts a job
            self.require_idle()
            before = self.objects.all()
            restore(self.store, path)
            self.jobs.interrupt()  # those that were under way when the backup was made
        self.load()
        for name in {each.name for each in before} - {each.name for each in self.objects.all()}:
            self.objects.restore(name)  # forgets it

    def close(self) -> None:
        """Gives control back and ends the jobs; robot, cameras and store stay their owner's to close."""
        self.closing.set()
        self.control.close()
        self.jobs.close()

    def grab(self, not_older_than: float) -> StereoPair:
        """A stereo pair that shows the world at `not_older_than` (world time in s) or later."""
        return self.cameras.grab_stereo(not_older_than, self.settings.grab_timeout)

    def show_object(self, name: str, kind: PictureKind, not_older_than: float) -> TaughtObject:
        """Grabs a pair of the scene without or with the object, and learns the object from all pairs so far."""
        return self.objects.add(name, kind, self.grab(not_older_than), lambda write: write())

    def look(
        self,
        demonstration_id: str,
        subtask: str,
        object_name: str | None = None,
        *,
        goal: bool,
        object_at: ImagePoint | None = None,
    ) -> tuple[Sighting, RobotState]:
        """What is seen and read now, for an observation of a demonstration; towards its own object for None.

        With `object_at` the object is where a person has marked it, and only the hand is looked for.

        `Busy` while the arm moves, `NotSeen` when object or hand is not found in both pictures, `Conflict` when the
        demonstration cannot take the observation, `DeadlineExceeded` without a picture of the arm at rest.
        """
        if object_name is not None:
            self.objects.require(object_name)
        demonstration = self.demonstrations.recordable(demonstration_id, subtask, object_name, goal=goal)
        state = self.acting.resting_state()
        pair = self.eyes.grab(state.still_since)
        sighting = self.eyes.recognise(pair, object_name or demonstration.object, object_at)
        if isinstance(sighting.found, NotSeen):
            raise sighting.found
        if self.acting.resting_state().still_since != state.still_since:
            raise Busy("the arm moved while it was looked at; observe again once it stands still")
        return sighting, state

    def observe(
        self, demonstration_id: str, subtask: str, object_name: str | None = None, *, goal: bool, key: bool
    ) -> Observation:
        """Adds what is seen and read now to a demonstration; raises as `look` does."""
        seen = self.look(demonstration_id, subtask, object_name, goal=goal)
        return self.record(demonstration_id, subtask, object_name, seen, goal=goal, key=key)

    def record(
        self,
        demonstration_id: str,
        subtask: str,
        object_name: str | None,
        seen: tuple[Sighting, RobotState],
        *,
        goal: bool,
        key: bool,
    ) -> Observation:
        """Adds what `look` returned to a demonstration."""
        sighting, state = seen
        assert not isinstance(sighting.found, NotSeen)  # noqa: S101 # `look` raises it
        return self.demonstrations.observe(
            demonstration_id,
            subtask,
            sighting.found,
            state.joints,
            sighting.world_time,
            goal=goal,
            key=key,
            object_name=object_name,
            head=HeadAngles(sighting.pair.head.pan, sighting.pair.head.tilt),
        )

    def pass_by(self, demonstration_id: str, subtask: str) -> Observation:
        """Adds where the arm stands now to a subtask's way, without looking; `Busy` while it moves."""
        state = self.acting.resting_state()
        return self.demonstrations.pass_by(demonstration_id, subtask, state.joints, state.still_since, state.world_time)

    def untrain(self, demonstration_id: str) -> None:
        """Deletes a demonstration, and its samples from every module; the next query does not know them."""
        with self.store.write():
            self.demonstrations.delete(demonstration_id)
            self.modules.forget_demonstration(demonstration_id)

    def train_task(self, task: str, request: TrainRequest) -> Job:
        """Starts a job that builds the task's module from its finished demonstrations; its result says what it made."""

        def work(job: Job) -> None:
            with self.store.write():  # no demonstration is deleted between
                made = self.tasks.train(task, self.demonstrations.trainable(task), request)
            job.finish(made)
            job.report(1.0)

        return self.jobs.start("train", task, None, work, acts=False)

    def train_module(self, module: str, approximator: ApproximatorSettings | None) -> Job:
        """Starts a job that builds a module anew from the store, with other settings if they are given."""
        try:
            self.modules.stored(module).declaration.answering_by(approximator)
        except ValidationError as error:
            raise Invalid(f"Module '{module}' cannot answer so: {error.errors()[0]['msg']}.") from error

        def work(job: Job) -> None:
            def report(share: float) -> None:
                job.check()
                job.report(share)

            built = self.modules.retrain(module, approximator, report)
            job.finish(module_statistics(module, built))
            job.report(1.0)

        return self.jobs.start("train", module, None, work, acts=False)

    def statistics(self, module: str) -> ModuleStatistics:
        """What a module learned, by category."""
        return module_statistics(module, self.modules.live(module))

    def run(self, task: str, object_name: str, *, one_look: bool, least_support: float | None = None) -> Job:
        """Starts a job that does a trained task; `Busy` while another job or a person controls the robot.

        `least_support` stands for the setting of that name.
        """
        skill = self.tasks.get(task)
        self.tasks.module(skill)
        for name in dict.fromkeys((object_name, *(each.object for each in skill.subtasks if each.object))):
            self.objects.require(name)
        settings = self.settings.acting
        if least_support is not None:
            settings = settings.model_copy(update={"least_support": least_support})

        def work(job: Job, robot: ActingRobot, looker: Looker) -> None:
            album = self.acting.album(job)
            felt = FeltHand(lambda: self.demonstrations.known(skill.demonstrations))
            run = Run(skill, object_name, robot, looker, self.eyes, settings, job, album, felt, one_look=one_look)
            run.execute()

        return self.acting.start("run", task, object_name, work)

    def stop(self, reason: str) -> RobotState:
        """Stops the robot and cancels the job that acts: it must not go on when the stop is cleared."""
        try:
            return self.robot.stop(reason)
        finally:
            if (acting := self.jobs.acting) is not None:
                acting.cancel()

    def reset(self) -> RobotState:
        """Clears the stop; `JobBusy` while a job acts, for it would go on. One that ends is waited for a while."""
        acting = self.jobs.acting
        if acting is not None and not (acting.cancelled and acting.wait(_ENDING)):
            raise self.jobs.busy(acting)
        return self.robot.reset()

    def require_idle(self) -> None:
        """`Busy` while a job is under way or somebody has control of the robot."""
        self.jobs.require_none()
        self.control.require_free()
