"""The physics of a world: its bodies, the controllers that drive them, and what has happened so far."""

from __future__ import annotations

import numpy as np
import pybullet
from numpy.typing import NDArray

from handeye.rpc.errors import Internal, InvalidArgument
from handeye.simulation import kinematics, liquid, placement, scene
from handeye.simulation.conditions import ORDINARY, Conditions
from handeye.simulation.controllers import ArmController, GripperController
from handeye.simulation.grasping import PARK
from handeye.simulation.history import History, Row
from handeye.simulation.mishaps import Mishaps
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.pose import Pose
from handeye.simulation.profile import Profile
from handeye.simulation.pushing import Push
from handeye.simulation.scene import ARM_JOINTS, FINGER_1, FINGER_2, STEP
from handeye.simulation.stillness import Stillness

Array = NDArray[np.float64]

_SOLVER_ITERATIONS = 60


class Physics:
    """A PyBullet client with robot and objects in it, from `build` to `build`. For one thread: `World` has the lock.

    The same profile, seed and calls give the same states, bit for bit. `close` frees the client.
    """

    def __init__(self, profile: Profile, grip_force: float, seed: int) -> None:
        """`grip_force`: of each finger, in N; `seed`: of everything random."""
        self._profile = profile
        self._grip_force = grip_force
        self.version = 0
        """Changes with every build and every object placed, held, filled, removed."""
        self.client: int = pybullet.connect(pybullet.DIRECT)
        """PyBullet's number; negative once it is closed."""
        if self.client < 0:
            raise Internal("PyBullet gives no physics client: too many are open in this process")
        self.build(seed, ORDINARY)

    def close(self) -> None:
        """Frees the client; may be called twice."""
        if self.client >= 0:
            pybullet.disconnect(physicsClientId=self.client)
            self.client = -1

    def build(self, seed: int, conditions: Conditions) -> None:
        """Makes everything anew: arm parked, gripper open, no objects, no steps."""
        client = self.client
        pybullet.resetSimulation(physicsClientId=client)
        pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=STEP,
            numSolverIterations=_SOLVER_ITERATIONS,
            contactBreakingThreshold=0.001,
            enableConeFriction=1,
            deterministicOverlappingPairs=1,
            physicsClientId=client,
        )
        self.seed = seed
        self.conditions = conditions
        self.stage = scene.build(client)
        offsets, travel = np.array(conditions.joint_offsets), conditions.opening / 2
        self.arm = ArmController(self.stage, self._profile, PARK, offsets, np.random.default_rng(seed))
        self.gripper = GripperController(self.stage, self._grip_force, travel)
        self.stage.set_joints(self.arm.link, np.full(2, travel))
        self.specs: dict[str, ObjectSpec] = {}
        self.history = History()
        self.steps = 0
        self.stillness = Stillness()
        self._mishaps = Mishaps(self.stage, conditions) if conditions != ORDINARY else None
        self._pushes: dict[str, Push] = {}
        self.version += 1
        self._read_joints()
        self.history.append(self._row())

    def step(self) -> None:
        """Lets one physics step pass."""
        if self._mishaps is not None:
            tool = kinematics.forward(self.joints)[:3, 3]
            self._mishaps.before_step(tool, moving=self.stillness.busy)
        self.arm.drive()
        self.gripper.drive()
        for name in [name for name, push in self._pushes.items() if not push.drive()]:
            del self._pushes[name]
        pybullet.stepSimulation(physicsClientId=self.client)
        self.steps += 1
        self._observe()
        self.history.append(self._row())

    def known(self, name: str) -> ObjectSpec:
        """The object of that name; `InvalidArgument` when there is none."""
        if name not in self.specs:
            known = ", ".join(self.specs) or "none"
            raise InvalidArgument(f"no object {name!r} is in the world; there are: {known}", detail="name")
        return self.specs[name]

    def put(self, spec: ObjectSpec, pose: Pose, *, fixed: bool = False) -> None:
        """Puts an object somewhere, where `fixed` holds it; one of the same name is replaced."""
        placement.put(self.stage, spec, pose, fixed=fixed)
        self._pushes.pop(spec.name, None)
        self.specs.pop(spec.name, None)  # what replaces another counts as put last
        self.specs[spec.name] = spec
        self._changed()

    def remove(self, name: str) -> None:
        """Takes an object away; raises as `known` does."""
        self.known(name)
        del self.specs[name]
        self._pushes.pop(name, None)
        self.stage.remove(name)
        self._changed()

    def fill(self, name: str, particles: int) -> None:
        """Fills liquid into a cup; `InvalidArgument` when that cannot be."""
        spec = self.known(name)
        if self.stage.particles:
            raise InvalidArgument("there is liquid in the world already; reset the world first", detail="name")
        if particles < 1:
            raise InvalidArgument(f"at least one particle must be filled in, got {particles}", detail="particles")
        pose = self.history.recall(self.steps).object(name).pose
        self.stage.fill(liquid.places(spec, pose, particles, np.random.default_rng(self.seed)))
        self._changed()

    def push(self, name: str, path: Array, speed: float) -> float:
        """Begins to push an object along a path; returns how long that takes, in s."""
        push = Push(self.stage, self.known(name), path, speed)
        self._pushes[name] = push
        return push.duration

    def _observe(self) -> None:
        """Reads the joints and judges whether arm and gripper stand still."""
        self._read_joints()
        self.gripper.observe(self.fingers)
        led = self.arm.motion is not None or not self.gripper.settled
        self.stillness.observe(self.joints, led=led)

    def _read_joints(self) -> None:
        states = pybullet.getJointStates(
            self.stage.robot, (*ARM_JOINTS, FINGER_1, FINGER_2), physicsClientId=self.client
        )
        self.joints: Array = np.array([state[0] for state in states[:6]])
        self.fingers: Array = np.array([state[0] for state in states[6:]])

    def _row(self) -> Row:
        """Joints, fingers, objects and liquid as they are."""
        numbers = [*self.joints, *self.fingers]
        for body in self.stage.objects.values():
            position, orientation = pybullet.getBasePositionAndOrientation(body, physicsClientId=self.client)
            numbers += [*position, *orientation, *self._touches(body)]
        if self.stage.particles:
            numbers += liquid.read(self.client, self.stage.particles).ravel().tolist()
        return Row(self.version, tuple(self.stage.objects), np.array(numbers))

    def _touches(self, body: int) -> tuple[bool, bool]:
        contacts = pybullet.getContactPoints(self.stage.robot, body, physicsClientId=self.client)
        pressed = {contact[3] for contact in contacts if contact[9] > 0.0}
        return FINGER_1 in pressed, FINGER_2 in pressed

    def _changed(self) -> None:
        """The scene is another one now, and so is the newest state."""
        self.version += 1
        self.history.replace(self._row())
