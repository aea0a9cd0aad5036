"""The lab bus carries the world exactly."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from pydantic import SecretStr

from handeye.robot_bridge.drivers.simulated import SimulatedRobot
from handeye.rpc import Bus, LabBusSettings
from handeye.rpc.errors import Busy, InvalidArgument
from handeye.simulation import grasping
from handeye.simulation.conditions import ORDINARY, Conditions
from handeye.simulation.lab import LabClient, LabService, conditions_from_proto, conditions_to_proto
from handeye.simulation.objects import BALL, CUPS, ObjectSpec
from handeye.simulation.pose import Pose
from handeye.simulation.world import World

CUP = CUPS["green mug"]


@pytest.fixture
def lab(world: World) -> Iterator[LabClient]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    settings = LabBusSettings(endpoint=f"tcp/127.0.0.1:{port}", user="lab", password=SecretStr("secret"))
    with (
        Bus.host(settings, credentials={"lab": "secret"}, name="robot-bridge") as host,
        LabService(world, host),
        Bus.open(settings, name="test") as bus,
    ):
        yield LabClient(bus)


def test_scene_and_states_arrive_as_they_are(world: World, lab: LabClient) -> None:
    scene = lab.place(CUP, np.array([0.6, 0.05]), yaw=0.5)
    assert scene == world.scene() == lab.scene()
    SimulatedRobot(world).move_to_joints(grasping.PARK + 0.05)
    for when in (None, 0.1):
        here, there = world.state(when), lab.world(when)
        assert (here.world_time, here.scene_version) == (there.world_time, there.scene_version)
        assert np.array_equal(here.joints, there.joints)
        assert np.array_equal(here.fingers, there.fingers)
        for a, b in ((here.tool, there.tool), (here.object(CUP.name).pose, there.object(CUP.name).pose)):
            assert np.array_equal(a.position, b.position)
            assert np.array_equal(a.orientation, b.orientation)
    times = [state.world_time for state in lab.history(0.0, every=0.1)]
    assert times == [state.world_time for state in world.history(0.0, every=0.1)]
    assert lab.remove(CUP.name).objects == ()
    assert lab.reset(9).seed == 9
    assert lab.world().world_time == 0.0


def test_conditions_stand_until_the_next_reset(world: World, lab: LabClient) -> None:
    """Encoders read too much, the gripper opens less, the head is turned: and nothing that the robot says tells."""
    conditions = Conditions(0.07, (0.0, 0.01, 0.0, 0.0, -0.02, 0.0), (0.03, -0.01))
    scene = lab.reset(4, conditions)
    assert scene.conditions == conditions
    assert scene == world.scene() == lab.scene()
    robot = SimulatedRobot(world)
    assert robot.state().joints == pytest.approx(grasping.PARK, abs=1e-3)
    assert lab.world().joints == pytest.approx(grasping.PARK - conditions.joint_offsets, abs=2e-3)
    assert robot.state().gripper_opening == pytest.approx(0.07, abs=1e-3)
    goal = grasping.PARK + 0.1
    assert robot.move_to_joints(goal).joints == pytest.approx(goal, abs=1e-3)
    assert lab.world().joints == pytest.approx(goal - conditions.joint_offsets, abs=2e-3)
    robot.close_gripper()
    assert robot.open_gripper().gripper_opening == pytest.approx(0.07, abs=1e-3)
    assert lab.reset(4).conditions == ORDINARY
    assert robot.state().gripper_opening == pytest.approx(0.09, abs=1e-3)


@pytest.mark.parametrize(
    "wrong",
    [{"opening": 0.2}, {"joint_offsets": (0.0,)}, {"joint_offsets": (np.nan,) * 6}, {"head_bump": (1.0, 0.0)}],
)
def test_conditions_that_cannot_be_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"opening|offsets"):
        Conditions(**wrong)
    message = conditions_to_proto(ORDINARY)
    message.opening = 0.2
    with pytest.raises(InvalidArgument, match="opening"):
        conditions_from_proto(message)


def test_an_object_is_held_where_it_is_said(world: World, lab: LabClient) -> None:
    lab.place(BALL, (0.6, 0.0))
    pose = Pose(np.array([0.6, 0.1, 0.5]), np.array([0.5, 0.5, -0.5, 0.5]))
    scene = lab.hold(BALL, pose)
    assert scene == world.scene() == lab.scene()
    assert scene.objects == (BALL,)
    held = lab.world().object(BALL.name).pose
    assert np.array_equal(held.position, pose.position)
    assert np.array_equal(held.orientation, pose.orientation)
    for wrong in (
        Pose(np.array([0.6, 0.1, np.nan]), pose.orientation),
        Pose(np.empty(0), np.empty(0)),
        Pose(pose.position, 2 * pose.orientation),
        Pose(np.array([0.6, 0.1, 0.0]), pose.orientation),
    ):
        with pytest.raises(InvalidArgument):
            lab.hold(BALL, wrong)
    assert lab.scene() == scene
    world.start_motion(grasping.PARK + 0.1, speed_share=0.5, acceleration_share=0.5)
    with pytest.raises(Busy):
        lab.hold(BALL, pose)


def test_an_object_is_pushed_from_afar(world: World, lab: LabClient) -> None:
    lab.place(CUP, (0.6, 0.0))
    begun = world.time
    ends = lab.push(CUP.name, [(0.7, 0.1), (0.6, 0.1)], 0.2)
    assert ends == pytest.approx(begun + (np.hypot(0.1, 0.1) + 0.1) / 0.2 + 0.5, abs=0.01)
    SimulatedRobot(world).advance(ends - begun + 0.1)
    np.testing.assert_allclose(lab.world().object(CUP.name).pose.position[:2], (0.6, 0.1), atol=5e-4)
    with pytest.raises(InvalidArgument, match="vase"):
        lab.push("vase", [(0.6, 0.1)], 0.1)


@pytest.mark.parametrize("odd", [np.nan, np.inf, 1e308])
def test_odd_numbers_are_refused(lab: LabClient, odd: float) -> None:
    before = lab.scene()
    for call in (
        lambda: lab.world(odd),
        lambda: lab.history(odd),
        lambda: lab.history(0.0, odd),
        lambda: lab.history(0.0, every=odd),
        lambda: lab.place(CUP, (odd, 0.0)),
        lambda: lab.place(CUP, (0.6, odd)),
    ):
        with pytest.raises(InvalidArgument):
            call()
    for yaw in (np.nan, np.inf):
        with pytest.raises(InvalidArgument, match="yaw"):
            lab.place(CUP, (0.6, 0.0), yaw)
    assert lab.scene() == before


def test_errors_arrive_typed(world: World, lab: LabClient) -> None:
    with pytest.raises(InvalidArgument, match="the table reaches"):
        lab.place(CUP, (3.0, 0.0))
    with pytest.raises(InvalidArgument, match="is not known"):
        lab.world(5.0)
    vase = ObjectSpec("vase", "cup")
    object.__setattr__(vase, "shape", "vase")
    with pytest.raises(InvalidArgument, match="unknown shape"):
        lab.place(vase, (0.6, 0.0))
    world.start_motion(grasping.PARK + 0.1, speed_share=0.5, acceleration_share=0.5)
    with pytest.raises(Busy):
        lab.reset()
