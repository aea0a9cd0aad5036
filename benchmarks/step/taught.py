"""A coordinator taught as much as `handeye demo` and `handeye evaluate reach` teach it; a robot that stands still."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import cast

import numpy as np

from benchmarks.learner.data import LAB
from benchmarks.step.cameras import StillHead
from benchmarks.step.scenes import CUP, Floats
from handeye.camera_bridge.driver import CameraDriver, StereoPair
from handeye.modules import ajs, cas, css
from handeye.modules.spaces import ArmPoint, CameraPoint, HeadAngles, ImagePair, ImagePoint, JointAngles
from handeye.robot_bridge.driver import Joints, Pace, RobotDescription, RobotState, Watch, unwatched
from handeye.rpc.errors import Unreachable
from handeye.server.acting import ActingSettings
from handeye.server.control import Control, ControlledRobot
from handeye.server.coordinator import Coordinator
from handeye.server.eyes import Vision
from handeye.server.reach import ReachSettings
from handeye.server.settings import ServerSettings
from handeye.server.store import Store
from handeye.server.training import TrainRequest
from handeye.simulation import grasping, kinematics, rig
from handeye.simulation.collecting import POSTURES
from handeye.simulation.experimenter import volume_views
from handeye.simulation.profile import Profile

TASK = "grasp"
LOOKS = 8
"""A subtask, or a reach, has so many: nothing comes nearer, because nothing moves."""

_DEMONSTRATIONS = 10
_GRIPPER = {"grasp": "close_gripper"}
_PAIRS = 4  # AJS: samples for each posture
_LOOKS = 3  # CAS: samples for each posture
_REGION = (0.31, -0.29, 0.03), (0.89, 0.29, 0.39)  # m

FULL = Pace()

_NEVER, _ALWAYS = 1e-12, 1e9
SETTINGS = ServerSettings(
    acting=ActingSettings(
        max_looks=LOOKS,
        tolerance=_NEVER,
        last_tolerance=_NEVER,
        acceptable=_ALWAYS,
        least_support=0.0,
        largest_move=_ALWAYS,
    ),
    reaching=ReachSettings(
        max_looks=LOOKS, tolerance=_NEVER, acceptable=_ALWAYS, least_support=0.0, largest_move=_ALWAYS
    ),
)
"""Every look is followed by an answer and a move; all else is as it comes."""


class StillRobot:
    """A robot on which every motion ends at once, where it began: motion is not what is measured."""

    lease_id = "a lease"

    def __init__(self, joints: Joints) -> None:
        limits = np.full(6, np.pi)
        self.description = RobotDescription(
            tuple(f"joint{n}" for n in range(1, 7)), -limits, limits, limits, limits, joints, 0.09, "realtime"
        )
        point = kinematics.forward(joints)[:3, 3]
        self._state = RobotState(1.0, joints, np.zeros(6), point, 0.09, False, False, 0.5)

    @contextmanager
    def lease(self) -> Iterator[None]:
        """Nobody else wants it."""
        yield

    def beat(self) -> None:
        """Nobody listens."""

    def state(self) -> RobotState:
        """Always the same."""
        return self._state

    def adjust_joints(
        self, delta: Joints, pace: Pace = FULL, watch: Watch = unwatched, least_opening: float = 0.0
    ) -> RobotState:
        """Done."""
        return self._state

    def open_gripper(self, watch: Watch = unwatched) -> RobotState:
        """Done."""
        return self._state

    def close_gripper(self, watch: Watch = unwatched) -> RobotState:
        """Done."""
        return self._state

    def advance(self, duration: float, watch: Watch = unwatched) -> RobotState:
        """Done."""
        return self._state

    def stop(self, reason: str = "") -> RobotState:
        """It stands still."""
        return self._state

    def reset(self) -> RobotState:
        """It never stopped."""
        return self._state


@contextmanager
def coordinator(store: Store, cameras: CameraDriver) -> Iterator[Coordinator]:
    """A coordinator that knows nothing yet."""
    robot = StillRobot(grasping.PARK)
    control = Control(lambda _holder: cast(ControlledRobot, robot), StillHead())
    with (
        closing(Vision()) as vision,
        closing(Coordinator(store, robot, control, cameras, vision, SETTINGS, list)) as made,
    ):
        made.load()
        yield made


def teach(there: Coordinator, backgrounds: list[StereoPair], examples: list[StereoPair], seed: int) -> None:
    """What the cup looks like, the task, and the modules of the chain."""
    random = np.random.default_rng(seed)
    for kind, pairs in (("backgrounds", backgrounds), ("examples", examples)):
        for pair in pairs:
            there.objects.add(CUP.name, kind, pair, lambda write: write())  # type: ignore[arg-type]
    _teach_task(there)
    for declaration, (inputs, outputs) in (
        (css.DECLARATION, _css(random)),
        (cas.DECLARATION, _cas(random)),
        (ajs.DECLARATION, _ajs(random)),
    ):
        there.modules.replace(declaration, inputs, outputs, [None] * len(inputs))


def _teach_task(there: Coordinator) -> None:
    """The lab's recorded grasp: what was seen then is the way from hand to object, so the hand may be anywhere."""
    hand = ImagePoint(0.0, 0.0, 0.0)
    with np.load(LAB) as recorded:
        names = [str(name) for name in recorded["subtask_names"]]
        for number in range(_DEMONSTRATIONS):
            shown = there.demonstrations.begin(TASK, CUP.name).id
            rows = np.flatnonzero(recorded["demonstration"] == number)
            for place, name in enumerate(names):
                mine = rows[recorded["subtask"][rows] == place]
                still = int(np.abs(recorded["outputs"][mine]).max(axis=1).argmin())
                for each, row in enumerate(mine):
                    way, joints = recorded["inputs"][row][:3], recorded["inputs"][row][3:]
                    found = ImagePair(ImagePoint(*way.tolist()), hand)
                    there.demonstrations.observe(
                        shown, name, found, joints, float(row), goal=each == still, key=each == 0
                    )
                if name in _GRIPPER:
                    there.demonstrations.act(shown, name, "close_gripper")
            there.demonstrations.finish(shown)
    job = there.train_task(TASK, TrainRequest())
    job.wait(60.0)
    if (error := job.view().error) is not None:
        raise AssertionError(error.message)


def _css(random: np.random.Generator) -> tuple[Floats, Floats]:
    """As many grids as the experimenter shows."""
    world_from_camera = np.linalg.inv(rig.left_from_world(0.0, 0.0))
    points = np.concatenate(
        [view.points()[:: view.every, :: view.every].reshape(-1, 3) for view in volume_views(random)]
    )
    world = points @ world_from_camera[:3, :3].T + world_from_camera[:3, 3]
    profile = Profile.named("default")
    left, right = (rig.project(world, name, 0.0, 0.0, profile) for name in ("left", "right"))
    return np.column_stack([left, left[:, 1] - right[:, 1]]), points


def _cas(random: np.random.Generator) -> tuple[Floats, Floats]:
    """The hand anywhere, seen from a few poses of the head."""
    inputs, outputs = [], []
    for _ in range(POSTURES["CAS"]):
        arm = random.uniform(*_REGION)
        for pan, tilt in zip(random.uniform(-0.4, 0.4, _LOOKS), random.uniform(-0.8, -0.2, _LOOKS), strict=True):
            camera = (rig.left_from_world(pan, tilt) @ np.append(arm, 1.0))[:3]
            inputs.append(cas.input_vector(CameraPoint(camera), HeadAngles(pan, tilt)))
            outputs.append(arm)
    return np.array(inputs), np.array(outputs)


def _ajs(random: np.random.Generator) -> tuple[Floats, Floats]:
    """From a few postures to each."""
    postures: list[Floats] = []
    while len(postures) < POSTURES["AJS"]:
        try:
            x, y, z = random.uniform(*_REGION)
            postures.append(grasping.solve(grasping.grasp_pose(np.array([x, y]), z)))
        except Unreachable:
            continue
    inputs, outputs = [], []
    for joints in postures:
        point = ArmPoint(kinematics.forward(joints)[:3, 3])
        for other in random.integers(len(postures), size=_PAIRS):
            inputs.append(ajs.input_vector(point, JointAngles(postures[other])))
            outputs.append(joints - postures[other])
    return np.array(inputs), np.array(outputs)
