"""A pursuit on a real stack in realtime: a cup is pushed over the table, and stays near the middle of what is seen."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from handeye.cli.up import Clock, Stack
from handeye.client import Client
from handeye.modules import scs
from handeye.modules.spaces import Floats, ImagePoint
from handeye.rpc import Bus
from handeye.simulation import rig
from handeye.simulation.experimenter import Experimenter
from handeye.simulation.lab import LabClient
from handeye.simulation.objects import CUPS
from handeye.simulation.profile import Profile
from handeye.simulation.teaching import lab_settings

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

CUP = CUPS["blue cup"]
SPEED = 0.05  # m/s


def teach_scs(client: Client) -> None:
    """From the rig's geometry: collecting it is tested elsewhere, and takes minutes."""
    random, profile = np.random.default_rng(1), Profile.named("default")
    inputs: list[Floats] = []
    outputs: list[Floats] = []
    while len(inputs) < 150:
        place = np.array([*random.uniform((0.45, -0.35), (0.95, 0.35)), random.uniform(0.03, 0.2)])
        pan, tilt = random.uniform((-0.5, -0.9), (0.5, -0.2))
        (row, column), (_, other) = (rig.project(place, name, pan, tilt, profile) for name in ("left", "right"))
        if not (30 < row < 450 and 60 < column < 610 and 30 < other < 610):
            continue
        inputs.append(scs.input_vector(ImagePoint(row, column, column - other), tilt))
        outputs.append(centring(place, pan, tilt) - (pan, tilt))
    client.create_module(scs.DECLARATION.model_dump(mode="json"))
    client.add_samples("SCS", np.array(inputs), np.array(outputs))


def centring(place: Floats, pan: float, tilt: float) -> Floats:
    """(2,): pan and tilt in rad with which a place is in the middle of the left picture, by Newton's method."""
    head, step = np.array([pan, tilt]), 1e-5

    def miss(at: Floats) -> Floats:
        return rig.project(place, "left", at[0], at[1], Profile.named("default")) - (239.5, 319.5)

    for _ in range(20):
        slope = np.column_stack([(miss(head + step * axis) - miss(head)) / step for axis in np.eye(2)])
        head = head - np.linalg.solve(slope, miss(head))
    return head


def test_a_pushed_cup_stays_near_the_middle(tmp_path: Path) -> None:
    with (
        Stack(tmp_path, clock=Clock.REALTIME) as stack,
        Client(stack.url, stack.token, timeout=60.0) as client,
        Bus.open(lab_settings(stack.lab), name="test") as bus,
    ):
        lab = LabClient(bus)
        teach_scs(client)
        Experimenter(lab, client, 1).register_cup(CUP)
        lab.place(CUP, (0.6, -0.2))
        assert client.gaze(CUP.name).raise_for_failure().result is not None
        still = client.head()
        lab.push(CUP.name, [(0.7, 0.3)], SPEED)
        pursuit = client.pursue(CUP.name, 6.0).raise_for_failure().result
        assert pursuit is not None
        assert len(pursuit.looks) >= 3
        assert all(look.offset is not None for look in pursuit.looks)
        # The head went with it; standing still it would have it more than 150 px beside the middle by now.
        assert abs(client.head().pan - still.pan) > 0.2
        assert np.median([look.offset for look in pursuit.looks if look.offset is not None]) < 30.0
        rates = [np.linalg.norm(look.rate) for look in pursuit.looks[2:]]
        assert 0.02 < np.median(rates) < 0.12
        time.sleep(1.5)  # it slows down, and nothing moves it any more
        assert not client.head().moving
