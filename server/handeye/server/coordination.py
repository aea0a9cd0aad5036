"""Hand and eye as a whole: what is seen, gaze, reaching, and collecting samples for the modules that do it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from handeye.modules import css, scs
from handeye.modules.grid import see_grid
from handeye.modules.spaces import ImagePoint
from handeye.server.acting import ActingRobot
from handeye.server.acting_jobs import ActingJobs
from handeye.server.chain import Chain, declaration_of
from handeye.server.collecting.babbling import Babbling, Region
from handeye.server.collecting.fixating import Fixation, Keep
from handeye.server.collecting.gathering import Gathering, require
from handeye.server.collecting.pupils import AjsPupil, CasPupil, IjsPupil, Pupil
from handeye.server.eyes import Eyes
from handeye.server.gaze import Gaze
from handeye.server.job import Job
from handeye.server.livemodules import LiveModules
from handeye.server.looking import Looker
from handeye.server.objects import Objects
from handeye.server.problem import Invalid
from handeye.server.pursuit import Pursuit
from handeye.server.reach import Reach
from handeye.server.schemas.coordination import LookInfo, PosturesRequest, ReachRequest
from handeye.server.settings import ServerSettings


class Coordination:
    """What the five-module chain and SCS are for. Methods that start a job raise `Busy` while somebody else acts."""

    def __init__(
        self, acting: ActingJobs, modules: LiveModules, objects: Objects, eyes: Eyes, settings: ServerSettings
    ) -> None:
        self._acting = acting
        self._modules = modules
        self._objects = objects
        self._eyes = eyes
        self.settings = settings
        self._chain = Chain(modules)

    def reach(self, request: ReachRequest) -> Job:
        """Starts a job that brings the hand to a point or an object; raises as `run` does.

        `NothingTaught` when the head is to turn first and SCS was taught nothing.
        """
        if request.object is not None:
            self._objects.require(request.object)
        if request.gaze:
            self._chain.require("SCS")
        target = request.object if request.point is None else ImagePoint(*request.point)

        def work(job: Job, robot: ActingRobot, looker: Looker) -> None:
            reach = Reach(
                self._chain,
                robot,
                looker,
                self._eyes,
                self.settings.reaching,
                self.settings.acting.thinking,
                job,
                self._acting.album(job),
            )
            assert target is not None  # noqa: S101 # for the type checker: the request has one of them
            reach.execute(target, one_look=request.one_look, gaze=request.gaze)

        return self._acting.start("reach", request.object or "point", request.object, work)

    def look(self, object_name: str | None, not_older_than: float) -> LookInfo:
        """Where an object, or the hand for None, is seen at `not_older_than` (world time in s) or later.

        `NotFound` when the object is not learned, `NotSeen` when it is not in both pictures, `DeadlineExceeded` without
        such pictures.
        """
        if object_name is not None:
            self._objects.require(object_name)
        pair = self._eyes.grab(not_older_than)
        point, confidence = self._eyes.see(pair, object_name)
        return LookInfo(
            point=(point.row, point.column, point.disparity),
            confidence=confidence,
            pan=pair.head.pan,
            tilt=pair.head.tilt,
            world_time=pair.left.world_time,
        )

    def gaze(self, object_name: str | None) -> Job:
        """Starts a job that centres an object, or the hand for None; raises as `run` does."""
        if object_name is not None:
            self._objects.require(object_name)

        def work(job: Job, _robot: ActingRobot, looker: Looker) -> None:
            Gaze(self._chain, looker, self._eyes, self.settings.gazing, job).execute(object_name)

        return self._acting.start("gaze", object_name or "hand", object_name, work)

    def pursue(self, object_name: str, duration: float) -> Job:
        """Starts a job that follows an object with the head for `duration` s of world time; raises as `run` does."""
        self._objects.require(object_name)
        self._chain.require("SCS")

        def work(job: Job, _robot: ActingRobot, looker: Looker) -> None:
            settings = self.settings.pursuing
            Pursuit(object_name, duration, self._chain, looker, self._eyes, settings, job).execute()

        return self._acting.start("pursuit", object_name, object_name, work)

    def collect_fixation(self, object_name: str, keep: Keep) -> Job:
        """Starts a job in which SCS learns from an object that is brought to the middle; raises as `run` does."""
        self._objects.require(object_name)
        gathering = Gathering(self._modules, (scs.DECLARATION,))

        def work(job: Job, _robot: ActingRobot, looker: Looker) -> None:
            with gathering.told_to(job):
                Fixation(looker, self._eyes, gathering, job).execute(object_name, keep)

        return self._acting.start("collect", "SCS", object_name, work)

    def collect_postures(self, request: PosturesRequest) -> Job:
        """Starts a job in which the arm babbles and modules learn; raises as `run` does.

        `NothingTaught` when CAS is to learn and CSS or SCS were taught nothing; `Invalid` for synergies of other joints
        than the robot has.
        """
        joints = len(self._acting.robot.description.joint_names)
        if any(len(direction) != joints for direction in request.synergies):
            raise Invalid(f"Each synergy must have {joints} numbers, one for each joint.")
        if "CAS" in request.modules:
            self._chain.require("CSS", "SCS")
        gathering = Gathering(self._modules, tuple(map(declaration_of, request.modules)))

        def work(job: Job, robot: ActingRobot, looker: Looker) -> None:
            region = Region(np.array(request.lower), np.array(request.upper))
            # Who goes on where it ended does not visit the same postures once more.
            visited = min(gathering.origins(module, "posture") for module in request.modules)
            seeds = np.random.SeedSequence((request.seed, visited)).spawn(2)
            pupils = self._pupils(request, gathering, looker, np.random.default_rng(seeds[0]))
            synergies, random = np.array(request.synergies), np.random.default_rng(seeds[1])
            babbling = Babbling(robot, self._chain, region, synergies, pupils, gathering, job, random)
            with gathering.told_to(job):
                babbling.execute(visited, request.postures)

        return self._acting.start("collect", ", ".join(request.modules), None, work)

    def see_grid(self, points: NDArray[np.float64], not_older_than: float) -> NDArray[np.float64]:
        """(rows, columns, 3) where a grid's intersections are seen, as many as `points` (rows, columns, 3) are.

        Makes module CSS, which is to learn from it, unless it is there; `Conflict` when it has other inputs or outputs.
        `NotSeen` when it is not whole in both pictures; `Busy` while the arm moves.
        """
        require(self._modules, css.DECLARATION)
        pair = self._eyes.grab(max(self._acting.resting_state().still_since, not_older_than))
        return see_grid(pair.left.image, pair.right.image, *points.shape[:2])

    def _pupils(
        self, request: PosturesRequest, gathering: Gathering, looker: Looker, random: np.random.Generator
    ) -> list[Pupil]:
        """IJS before CAS: it learns from the head's pose at the start, and CAS turns the head."""
        made: dict[str, Callable[[], Pupil]] = {
            "AJS": lambda: AjsPupil(gathering, random),
            "IJS": lambda: IjsPupil(gathering, looker, self._eyes, random),
            "CAS": lambda: CasPupil(gathering, self._chain, looker, self._eyes, random, request.looks),
        }
        return [make() for name, make in made.items() if name in request.modules]
