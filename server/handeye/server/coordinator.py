"""The coordinator: everything that the REST routes work on, wired together."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from handeye.camera_bridge.driver import CameraDriver, StereoPair
from handeye.modules import css, scs
from handeye.modules.declaration import ApproximatorSettings
from handeye.modules.grid import see_grid
from handeye.modules.recognition import NotSeen
from handeye.modules.spaces import ImagePoint
from handeye.robot_bridge.driver import Pace, RobotState
from handeye.rpc.errors import Busy
from handeye.server.acting import ActingHead, ActingRobot, LeasedRobot
from handeye.server.chain import Chain, declaration_of
from handeye.server.collecting.babbling import Babbling, Region
from handeye.server.collecting.fixating import Fixation, Keep
from handeye.server.collecting.gathering import Gathering, require
from handeye.server.collecting.pupils import AjsPupil, CasPupil, IjsPupil, Pupil
from handeye.server.control import Control
from handeye.server.demonstration import Observation
from handeye.server.demonstrations import Demonstrations
from handeye.server.executor import Run
from handeye.server.eyes import Eyes, Sight, Sighting
from handeye.server.gaze import Gaze
from handeye.server.jobs import Job, Jobs, Kind
from handeye.server.livemodules import LiveModules
from handeye.server.looking import Looker
from handeye.server.objects import Kind as PictureKind
from handeye.server.objects import Objects, TaughtObject
from handeye.server.problem import Invalid
from handeye.server.reach import Reach
from handeye.server.results import ModuleStatistics
from handeye.server.schemas.coordination import PosturesRequest, ReachRequest
from handeye.server.settings import ServerSettings
from handeye.server.statistics import module_statistics
from handeye.server.store import Store
from handeye.server.store import jobs as stored_jobs
from handeye.server.store.backup import restore
from handeye.server.training import Tasks, TrainRequest


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
        self.chain = Chain(self.modules)
        self.jobs = Jobs(store, settings.jobs_kept, on_job_end)
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

    def look(self, demonstration_id: str, subtask: str, *, goal: bool) -> tuple[Sighting, RobotState]:
        """What is seen and read now, for an observation of a demonstration.

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
        return sighting, state

    def observe(self, demonstration_id: str, subtask: str, *, goal: bool, key: bool) -> Observation:
        """Adds what is seen and read now to a demonstration; raises as `look` does."""
        return self.record(demonstration_id, subtask, self.look(demonstration_id, subtask, goal=goal), goal, key)

    def record(
        self, demonstration_id: str, subtask: str, seen: tuple[Sighting, RobotState], goal: bool, key: bool
    ) -> Observation:
        """Adds what `look` returned to a demonstration."""
        sighting, state = seen
        assert not isinstance(sighting.found, NotSeen)  # noqa: S101 # `look` raises it
        return self.demonstrations.observe(
            demonstration_id, subtask, sighting.found, state.joints, sighting.world_time, goal=goal, key=key
        )

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

    def run(self, task: str, object_name: str, *, one_look: bool) -> Job:
        """Starts a job that does a trained task; `Busy` while another job or a person controls the robot."""
        skill = self.tasks.get(task)
        self.tasks.module(skill)
        self.objects.require(object_name)

        def work(job: Job, robot: ActingRobot, looker: Looker) -> None:
            keep = self._picture_keeper(job)
            run = Run(skill, object_name, robot, looker, self.eyes, self.settings.acting, job, keep, one_look=one_look)
            run.execute()

        return self._act("run", task, object_name, work)

    def reach(self, request: ReachRequest) -> Job:
        """Starts a job that brings the hand to a point or an object; raises as `run` does."""
        if request.object is not None:
            self.objects.require(request.object)
        target = request.object if request.point is None else ImagePoint(*request.point)

        def work(job: Job, robot: ActingRobot, looker: Looker) -> None:
            reach = Reach(
                self.chain,
                robot,
                looker,
                self.eyes,
                self.settings.reaching,
                self.settings.acting.thinking,
                job,
                self._picture_keeper(job),
            )
            assert target is not None  # noqa: S101 # for the type checker: the request has one of them
            reach.execute(target, one_look=request.one_look)

        return self._act("reach", request.object or "point", request.object, work)

    def find(self, object_name: str | None, not_older_than: float) -> tuple[ImagePoint, StereoPair]:
        """Where an object, or the hand for None, is seen at `not_older_than` (world time in s) or later, and in what.

        `NotFound` when the object is not learned, `NotSeen` when it is not in both pictures, `DeadlineExceeded` without
        such pictures.
        """
        if object_name is not None:
            self.objects.require(object_name)
        pair = self.grab(not_older_than)
        return self.eyes.find(pair, object_name), pair

    def gaze(self, object_name: str | None) -> Job:
        """Starts a job that centres an object, or the hand for None; raises as `run` does."""
        if object_name is not None:
            self.objects.require(object_name)

        def work(job: Job, _robot: ActingRobot, looker: Looker) -> None:
            Gaze(self.chain, looker, self.eyes, self.settings.gazing, job).execute(object_name)

        return self._act("gaze", object_name or "hand", object_name, work)

    def collect_fixation(self, object_name: str, keep: Keep) -> Job:
        """Starts a job in which SCS learns from an object that is brought to the middle; raises as `run` does."""
        self.objects.require(object_name)
        gathering = Gathering(self.modules, (scs.DECLARATION,))

        def work(job: Job, _robot: ActingRobot, looker: Looker) -> None:
            with gathering.told_to(job):
                Fixation(looker, self.eyes, gathering, job).execute(object_name, keep)

        return self._act("collect", "SCS", object_name, work)

    def collect_postures(self, request: PosturesRequest) -> Job:
        """Starts a job in which the arm babbles and modules learn; raises as `run` does.

        `NothingTaught` when CAS is to learn and CSS or SCS were taught nothing; `Invalid` for synergies of other joints
        than the robot has.
        """
        joints = len(self.robot.description.joint_names)
        if any(len(direction) != joints for direction in request.synergies):
            raise Invalid(f"Each synergy must have {joints} numbers, one for each joint.")
        if "CAS" in request.modules:
            self.chain.require("CSS", "SCS")
        gathering = Gathering(self.modules, tuple(map(declaration_of, request.modules)))

        def work(job: Job, robot: ActingRobot, looker: Looker) -> None:
            region = Region(np.array(request.lower), np.array(request.upper))
            seeds = np.random.SeedSequence(request.seed).spawn(2)
            pupils = self._pupils(request, gathering, looker, np.random.default_rng(seeds[0]))
            synergies, random = np.array(request.synergies), np.random.default_rng(seeds[1])
            babbling = Babbling(robot, self.chain, region, synergies, pupils, gathering, job, random)
            with gathering.told_to(job):
                babbling.execute(request.postures)

        return self._act("collect", ", ".join(request.modules), None, work)

    def see_grid(self, points: NDArray[np.float64], not_older_than: float) -> NDArray[np.float64]:
        """(rows, columns, 3) where a grid's intersections are seen, as many as `points` (rows, columns, 3) are.

        Makes module CSS, which is to learn from it, unless it is there; `Conflict` when it has other inputs or outputs.
        `NotSeen` when it is not whole in both pictures; `Busy` while the arm moves.
        """
        require(self.modules, css.DECLARATION)
        pair = self.grab(max(self._resting_state().still_since, not_older_than))
        return see_grid(pair.left.image, pair.right.image, *points.shape[:2])

    def _pupils(
        self, request: PosturesRequest, gathering: Gathering, looker: Looker, random: np.random.Generator
    ) -> list[Pupil]:
        """IJS before CAS: it learns from the head's pose at the start, and CAS turns the head."""
        made: dict[str, Callable[[], Pupil]] = {
            "AJS": lambda: AjsPupil(gathering, random),
            "IJS": lambda: IjsPupil(gathering, looker, self.eyes, random),
            "CAS": lambda: CasPupil(gathering, self.chain, looker, self.eyes, random, request.looks),
        }
        return [make() for name, make in made.items() if name in request.modules]

    def _act(
        self, kind: Kind, subject: str, object_name: str | None, work: Callable[[Job, ActingRobot, Looker], None]
    ) -> Job:
        """Starts a job that acts under the control lease; `Busy` while another job or a person controls the robot."""
        self.control.require_free()
        acting = self.settings.acting

        def begin(job: Job) -> None:
            robot = ActingRobot(self.robot, lambda _done: job.check(), Pace(acting.pace, acting.pace))
            head = ActingHead(self.control.head, self.robot, job.check)
            with self.robot.lease():
                work(job, robot, Looker(robot, head, self.eyes, acting.settle, job.check))

        return self.jobs.start(kind, subject, object_name, begin, acts=True)

    def _picture_keeper(self, job: Job) -> Callable[[bytes], int]:
        """What keeps a job's pictures, and returns each one's number."""

        def keep(picture: bytes) -> int:
            with self.store.write() as connection:
                return stored_jobs.add_picture(connection, job.id, picture, self.settings.pictures_kept)

        return keep

    def require_idle(self) -> None:
        """`Busy` while a job is under way or somebody has control of the robot."""
        self.jobs.require_none()
        self.control.require_free()

    def _resting_state(self) -> RobotState:
        state = self.robot.state()
        if state.moving or not math.isfinite(state.still_since):
            raise Busy("the arm is moving; observe once it stands still")
        return state
