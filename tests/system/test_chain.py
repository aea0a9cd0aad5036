"""The whole chain on a real stack, small: it collects for itself, and its hand goes where a ball was seen."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from handeye.cli.up import Stack
from handeye.client import Client
from handeye.rpc import Bus
from handeye.simulation import grasping, kinematics
from handeye.simulation.experimenter import FRESH, Experimenter, volume_views
from handeye.simulation.gripper import marker_place
from handeye.simulation.lab import LabClient
from handeye.simulation.objects import BALL
from handeye.simulation.teaching import lab_settings

pytestmark = [pytest.mark.system, pytest.mark.timeout(600)]

SEED = 11
LOWER, UPPER = (0.45, -0.12, 0.06), (0.72, 0.12, 0.28)
GOALS = ((0.55, -0.05, 0.12), (0.62, 0.06, 0.20))


def ignore() -> None:
    """Nobody watches."""


def test_collects_gazes_and_reaches_from_pictures_and_encoders(tmp_path: Path) -> None:
    with (
        Stack(tmp_path) as stack,
        Client(stack.url, stack.token, timeout=60.0) as client,
        Bus.open(lab_settings(stack.lab), name="test") as bus,
    ):
        lab = LabClient(bus)
        experimenter = Experimenter(lab, client, SEED)
        experimenter.show_grid(volume_views(np.random.default_rng(SEED), depths=6), ignore)
        experimenter.register_ball()
        experimenter.show_ball(24, 8, ignore)
        babblers: tuple[tuple[Literal["AJS", "CAS"], int], ...] = (("AJS", 80), ("CAS", 30))
        for module, postures in babblers:
            lab.reset(SEED)
            collected = client.collect_postures(
                [module],
                postures=postures,
                lower=LOWER,
                upper=UPPER,
                seed=SEED,
            )
            assert collected.raise_for_failure().result is not None
        assert {each.name for each in client.modules()} == {"CSS", "SCS", "AJS", "CAS"}
        for goal in GOALS:
            lab.reset(SEED)
            place = marker_place(kinematics.forward(grasping.solve(grasping.grasp_pose(np.array(goal[:2]), goal[2]))))
            with client.control("test") as control:
                experimenter.hang_ball(place)
                hung = control.state().world_time
                control.advance(FRESH)
                assert client.look(BALL.name, hung).point[2] > 50.0
            gaze = client.gaze(BALL.name).raise_for_failure().result
            assert gaze is not None
            assert gaze.looks[-1].offset <= 3.0
            seen = client.look(BALL.name)
            experimenter.take_ball()
            reach = client.reach(seen.point).raise_for_failure().result
            assert reach is not None
            assert len(reach.looks) <= 6
            assert np.linalg.norm(marker_place(lab.world().tool.matrix()) - place) < 0.006
            # Every motion says what it came from.
            moved = [look for look in reach.looks if look.moved]
            assert moved
            assert all(answer.neighbours[0].demonstration for look in moved for answer in look.answers)
