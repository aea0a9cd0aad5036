"""Trying without looks whether a teacher could show a grasp at a place: the arm reaches, the cameras see, the cup stays
where it is until it is grasped."""

from __future__ import annotations

import numpy as np

from handeye.robot_bridge.remote import RemoteRobot
from handeye.rpc.errors import InvalidArgument, OutOfLimits, Unreachable
from handeye.simulation import grasping, gripper, rig
from handeye.simulation.lab import LabClient
from handeye.simulation.lessons import Move, grasp
from handeye.simulation.objects import ObjectSpec
from handeye.simulation.places import Place
from handeye.simulation.scene import WorldState
from handeye.simulation.teacher import PACE

_MOVED = 0.01
"""An object that the hand moves further than this, in m, before it is grasped is in its way."""


def can_grasp(robot: RemoteRobot, lab: LabClient, spec: ObjectSpec, place: Place) -> bool:
    """Whether the object can be grasped and lifted at `place`, in a new world and always in sight of both cameras."""
    lab.reset(place.seed)
    try:
        lab.place(spec, (place.x, place.y), place.yaw)
        moves = grasp(spec).plan(lab.world())
    except (InvalidArgument, Unreachable):
        return False
    with robot.lease():
        try:
            return all(_goes_well(robot, lab, spec, place, move) for move in moves) and lifted(lab.world(), spec)
        except OutOfLimits:
            return False


def lifted(world: WorldState, spec: ObjectSpec) -> bool:
    """Whether the object is in the air."""
    return bool(world.object(spec.name).pose.position[2] > grasping.LIFT_HEIGHT)


def _goes_well(robot: RemoteRobot, lab: LabClient, spec: ObjectSpec, place: Place, move: Move) -> bool:
    for joints in (move.goal, *move.way):
        if isinstance(joints, np.ndarray):
            robot.move_to_joints(joints, PACE)
    world = lab.world()
    stands = world.object(spec.name).pose.position
    shown = (stands, gripper.marker_place(world.tool.matrix()))
    if not all(rig.in_view(point, *rig.rig().head.home) for point in shown):
        return False
    if move.action == "close_gripper":
        if np.linalg.norm(stands[:2] - (place.x, place.y)) > _MOVED:
            return False
        robot.close_gripper()
    return True
