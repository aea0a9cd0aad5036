"""The scene that world and mirror share: table, floor, robot with hand, and the objects on the table.

`build` puts it into a PyBullet client; `Stage.apply` poses it as a `WorldState` says, which is all that a mirror does.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pybullet
from numpy.typing import NDArray

from handeye.simulation import gripper, liquid, objects, puma, urdf
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.pose import Pose

Array = NDArray[np.float64]

STEP = 1.0 / 240.0
"""One physics step, in s."""
ARM_JOINTS = tuple(range(6))
HAND_LINK, FINGER_1, FINGER_2 = 6, 7, 8
"""PyBullet's indices of the hand and of the fingers (joint and link)."""

WORKSPACE_CENTRE: Array = np.array([0.60, 0.0])
WORKSPACE_SIZE = 0.30
"""Objects to be grasped stand in this square on the table, in m."""
TABLE_X = (0.15, 1.10)
TABLE_Y = (-0.65, 0.65)
"""The table top, at z = 0, in m."""
ROOM = 4.0
"""The lab reaches so far from the world's origin along x, y and z, in m (downwards to the floor)."""

_TABLE_THICKNESS = 0.03
_FLOOR_THICKNESS = 0.1
_TABLE_COLOR = (0.80, 0.79, 0.76)
_LEG_COLOR = (0.35, 0.35, 0.36)
_FLOOR_COLOR = (0.30, 0.31, 0.33)
_TABLE_FRICTION = 0.6
_OUT_OF_SIGHT = (0.0, 0.0, -20.0)


@dataclass(frozen=True, slots=True)
class ObjectState:
    """Pose of an object's body frame (origin at the centre of its shape), and which fingers it touches."""

    name: str
    pose: Pose
    touches_finger_1: bool
    touches_finger_2: bool


@dataclass(frozen=True, slots=True, eq=False)
class WorldState:
    """The truth at one time: true joint angles (6,) in rad, fingers (2,) in m from the middle, tool, objects.

    `liquid` (n, 3): where its particles are, in m, world frame.
    """

    world_time: float
    scene_version: int
    joints: Array
    fingers: Array
    tool: Pose
    objects: tuple[ObjectState, ...]
    liquid: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def object(self, name: str) -> ObjectState:
        """The object of that name; `KeyError` when it is not in the world."""
        for state in self.objects:
            if state.name == name:
                return state
        raise KeyError(name)


@dataclass(slots=True)
class Stage:
    """A built scene: body ids in the PyBullet client `client`."""

    client: int
    robot: int
    table: int
    floor: int
    objects: dict[str, int] = field(default_factory=dict)
    particles: list[int] = field(default_factory=list)

    def add(self, spec: ObjectSpec) -> int:
        """Builds an object at the world's origin; returns its body id."""
        if spec.name in self.objects:
            raise ValueError(f"an object named {spec.name!r} is already there")
        self.objects[spec.name] = objects.build(self.client, spec)
        return self.objects[spec.name]

    def remove(self, name: str) -> None:
        """Takes an object out; `KeyError` when it is not there."""
        pybullet.removeBody(self.objects.pop(name), physicsClientId=self.client)

    def draw_floor_last(self) -> None:
        """Makes the floor anew: what stands before it is drawn first then, and what is hidden costs no shading."""
        pybullet.removeBody(self.floor, physicsClientId=self.client)
        self.floor = _floor(self.client)

    def set_joints(self, joints: Array, fingers: Array) -> None:
        """Poses arm and fingers at rest: joints (6,) in rad, fingers (2,) in m from the middle."""
        for index, angle in zip(ARM_JOINTS, joints, strict=True):
            pybullet.resetJointState(self.robot, index, float(angle), physicsClientId=self.client)
        for index, position in zip((FINGER_1, FINGER_2), fingers, strict=True):
            pybullet.resetJointState(self.robot, index, float(position), physicsClientId=self.client)

    def apply(self, state: WorldState) -> None:
        """Poses the scene as `state` says; objects that it does not have are moved out of sight."""
        self.set_joints(state.joints, state.fingers)
        poses = {item.name: item.pose for item in state.objects}
        for name, body in self.objects.items():
            pose = poses.get(name)
            position = _OUT_OF_SIGHT if pose is None else pose.position.tolist()
            orientation = (0.0, 0.0, 0.0, 1.0) if pose is None else pose.orientation.tolist()
            pybullet.resetBasePositionAndOrientation(body, position, orientation, physicsClientId=self.client)
        self.fill(state.liquid)

    def fill(self, where: Array) -> None:
        """Has particles of liquid at (n, 3), in m, and no others."""
        if len(where) != len(self.particles):
            for body in self.particles:
                pybullet.removeBody(body, physicsClientId=self.client)
            self.particles = liquid.build(self.client, where)
        liquid.apply(self.client, self.particles, where)


def build(client: int, specs: Iterable[ObjectSpec] = ()) -> Stage:
    """Puts table, floor, robot and objects into the empty PyBullet client `client` (the arm at zero)."""
    pybullet.setPhysicsEngineParameter(enableFileCaching=0, physicsClientId=client)
    floor = _floor(client)
    _legs(client)
    stage = Stage(client, robot=_robot(client), table=_table(client), floor=floor)
    for spec in specs:
        stage.add(spec)
    return stage


def _robot(client: int) -> int:
    with tempfile.TemporaryDirectory(prefix="handeye-robot-") as folder:
        path = Path(folder) / "puma560.urdf"
        arm = puma.links_and_joints()
        hand = gripper.links_and_joints(puma.JOINT_NAMES[-1], Path(folder))
        path.write_text(urdf.robot("puma560", arm, hand))
        robot: int = pybullet.loadURDF(
            str(path),
            basePosition=puma.BASE_POSITION.tolist(),
            useFixedBase=True,
            flags=pybullet.URDF_USE_INERTIA_FROM_FILE,
            physicsClientId=client,
        )
    for index in ARM_JOINTS:
        pybullet.changeDynamics(robot, index, localInertiaDiagonal=puma.INERTIA[index].tolist(), physicsClientId=client)
    for index in range(-1, pybullet.getNumJoints(robot, physicsClientId=client)):
        pybullet.changeDynamics(
            robot,
            index,
            linearDamping=0.0,
            angularDamping=0.0,
            jointDamping=0.0,
            lateralFriction=gripper.PAD_FRICTION,
            spinningFriction=objects.SPINNING_FRICTION,
            restitution=0.0,
            physicsClientId=client,
        )
    return robot


def _table(client: int) -> int:
    size = np.array([TABLE_X[1] - TABLE_X[0], TABLE_Y[1] - TABLE_Y[0], _TABLE_THICKNESS])
    centre = np.array([sum(TABLE_X) / 2, sum(TABLE_Y) / 2, -_TABLE_THICKNESS / 2])
    body = _box(client, size, centre, _TABLE_COLOR, solid=True)
    pybullet.changeDynamics(
        body,
        -1,
        lateralFriction=_TABLE_FRICTION,
        spinningFriction=objects.SPINNING_FRICTION,
        restitution=0.0,
        physicsClientId=client,
    )
    return body


def _floor(client: int) -> int:
    """A slab of which only the upper face shows: faces that nobody sees would be drawn too."""
    half = [ROOM, ROOM, _FLOOR_THICKNESS / 2]
    corners = [[-ROOM, -ROOM, half[2]], [ROOM, -ROOM, half[2]], [ROOM, ROOM, half[2]], [-ROOM, ROOM, half[2]]]
    shown = pybullet.createVisualShape(
        pybullet.GEOM_MESH,
        vertices=corners,
        indices=[0, 1, 2, 0, 2, 3],
        normals=[[0.0, 0.0, 1.0]] * len(corners),
        uvs=[[0.0, 0.0]] * len(corners),
        rgbaColor=[*_FLOOR_COLOR, 1.0],
        physicsClientId=client,
    )
    felt = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, physicsClientId=client)
    centre = (0.0, 0.0, puma.FLOOR - half[2])
    body: int = pybullet.createMultiBody(0.0, felt, shown, centre, physicsClientId=client)
    return body


def _legs(client: int) -> None:
    """The table's legs."""
    height = -_TABLE_THICKNESS - puma.FLOOR
    for x in TABLE_X:
        for y in TABLE_Y:
            inset = np.array([np.sign(sum(TABLE_X) / 2 - x), np.sign(-y)]) * 0.04
            centre = np.array([x + inset[0], y + inset[1], puma.FLOOR + height / 2])
            _box(client, np.array([0.05, 0.05, height]), centre, _LEG_COLOR, solid=False)


def _box(client: int, size: Array, centre: Array, color: urdf.Color, *, solid: bool) -> int:
    half = (size / 2).tolist()
    shown = pybullet.createVisualShape(
        pybullet.GEOM_BOX, halfExtents=half, rgbaColor=[*color, 1.0], physicsClientId=client
    )
    felt = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, physicsClientId=client) if solid else -1
    body: int = pybullet.createMultiBody(0.0, felt, shown, centre.tolist(), physicsClientId=client)
    return body
