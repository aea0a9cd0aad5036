"""Liquid: it stays in a cup, runs where the cup is tilted, and every camera sees it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from handeye.robot_bridge.driver import Pace
from handeye.robot_bridge.drivers.simulated import SimulatedRobot
from handeye.rpc.errors import InvalidArgument
from handeye.simulation import grasping, liquid
from handeye.simulation.lab import state_from_proto, state_to_proto
from handeye.simulation.mirror import Mirror
from handeye.simulation.objects import BALL, CUPS, JAR, ObjectSpec
from handeye.simulation.pose import Pose
from handeye.simulation.pouring import pouring_chain
from handeye.simulation.world import World

from .conftest import MakeWorld

CUP = CUPS["blue cup"]


def within(world: World, spec: ObjectSpec) -> int:
    """How many particles are in an object."""
    state = world.state()
    return int(liquid.inside(state.liquid, spec, state.object(spec.name).pose).sum())


def test_it_settles_in_the_cup_and_the_cup_stays(world: World) -> None:
    world.place(CUP, (0.6, 0.0))
    before = world.state().object(CUP.name).pose.position
    scene = world.fill(CUP.name, 40)
    assert scene.version == world.state().scene_version
    assert within(world, CUP) == 40
    state = world.state()
    assert np.linalg.norm(state.object(CUP.name).pose.position - before) < 1e-4
    # Settled: a quarter of the cup is full, and nothing moves any more.
    assert state.liquid[:, 2].max() < 0.04
    for _ in range(24):
        world.step()
    assert np.abs(world.state().liquid - state.liquid).max() < 2e-3


def test_the_same_seed_fills_in_the_same_way_and_another_does_not(make_world: MakeWorld) -> None:
    found = []
    for seed in (3, 3, 4):
        world = make_world(seed=seed)
        world.place(CUP, (0.6, 0.0))
        world.fill(CUP.name, 10)
        found.append(world.state().liquid)
    assert (found[0] == found[1]).all()
    assert (found[0] != found[2]).any()


def test_a_world_without_liquid_has_none_and_a_reset_takes_it_away(world: World) -> None:
    world.place(CUP, (0.6, 0.0))
    assert world.state().liquid.shape == (0, 3)
    before = world.time
    world.fill(CUP.name, 5)
    assert world.state(before).liquid.shape == (5, 3)  # the moment at which it was filled in
    assert world.state(before - 0.1).liquid.shape == (0, 3)
    world.reset()
    assert world.state().liquid.shape == (0, 3)


def test_it_is_told_over_the_lab_bus(world: World) -> None:
    world.place(CUP, (0.6, 0.0))
    world.fill(CUP.name, 3)
    state = world.state()
    assert (state_from_proto(state_to_proto(state)).liquid == state.liquid).all()


def test_what_cannot_be_filled_is_refused_and_nothing_changes(world: World) -> None:
    world.place(CUP, (0.6, 0.0))
    world.hold(BALL, Pose(np.array([0.6, 0.3, 0.3]), np.array([0.0, 0.0, 0.0, 1.0])))
    lying = replace(CUP, name="lying")
    world.hold(lying, Pose(np.array([0.6, -0.3, 0.3]), np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])))
    for name, count, why in (
        ("green cup", 1, "no object 'green cup'"),
        (BALL.name, 1, "holds no liquid"),
        (lying.name, 1, "not stand upright"),
        (CUP.name, 1000, "has room for"),
        (CUP.name, 0, "at least one"),
    ):
        with pytest.raises(InvalidArgument, match=why):
            world.fill(name, count)
    assert world.state().liquid.shape == (0, 3)
    world.fill(CUP.name, 1)
    with pytest.raises(InvalidArgument, match="liquid in the world already"):
        world.fill(CUP.name, 1)


def test_the_cameras_see_it_and_no_longer_when_it_is_gone(world: World) -> None:
    """From above, with the head looking down at a cup near it."""
    shallow = ObjectSpec("saucer", "cup", radius=0.06, height=0.02, color=(0.9, 0.9, 0.9))
    with Mirror(_Direct(world)) as mirror:
        world.place(shallow, (0.6, 0.0))
        empty, _ = mirror.picture("left", world.time, 0.0, np.radians(-30))
        world.fill(shallow.name, 10)
        full, _ = mirror.picture("left", world.time, 0.0, np.radians(-30))
        again, _ = mirror.picture("left", world.time, 0.0, np.radians(-30))
        assert again is full
        changed = np.abs(full.astype(int) - empty).max(axis=2) > 60
        assert 50 < changed.sum() < 3000
        world.reset()
        world.place(shallow, (0.6, 0.0))
        without, _ = mirror.picture("left", world.time, 0.0, np.radians(-30))
        assert (without == empty).all()


class _Direct:
    """The world as the mirror asks for it."""

    def __init__(self, world: World) -> None:
        self.scene = world.scene
        self.world = world.state


def pour(world: World, aim: tuple[float, float]) -> tuple[int, int]:
    """Pours from a cup into the jar by a scripted motion that is off by `aim`, m: particles in the jar, in the cup."""
    robot = SimulatedRobot(world)
    cup, jar = np.array([0.50, -0.12]), np.array([0.56, 0.14])
    world.place(CUP, cup)
    world.place(JAR, jar)
    world.fill(CUP.name, 40)
    taking = grasping.solve_chain(cup, CUP.height / 2)
    pace = Pace(0.5, 0.5)
    robot.move_to_joints(taking["approach"], pace)
    robot.move_to_joints(taking["grasp"], pace)
    robot.close_gripper()
    chain = pouring_chain(jar + aim, JAR, CUP, taking["grasp"])
    robot.move_to_joints(chain["above"][0], pace)
    robot.move_to_joints(chain["start"][0], pace)
    assert within(world, CUP) == 40
    for joints in chain["turned"]:
        robot.move_to_joints(joints, Pace(0.2, 0.5))
    robot.advance(1.0)
    robot.move_to_joints(chain["start"][0], Pace(0.2, 0.5))
    assert np.linalg.norm(world.state().object(JAR.name).pose.position[:2] - jar) < 2e-3
    return within(world, JAR), within(world, CUP)


def test_a_scripted_motion_pours_it_into_the_jar_though_its_aim_is_some_millimetres_off(make_world: MakeWorld) -> None:
    arrived, left = pour(make_world("default", seed=2), (0.004, -0.004))
    assert arrived >= 36
    assert left <= 2


def test_poured_beside_the_jar_it_is_lost_and_the_floor_stops_it(make_world: MakeWorld) -> None:
    world = make_world()
    arrived, left = pour(world, (0.0, -0.10))
    assert arrived == 0
    assert left <= 2
    state = world.state()
    assert state.liquid[:, 2].max() < 0.2
    assert state.liquid[:, 2].min() > -1.5
