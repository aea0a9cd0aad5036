"""The Python client against the real application: robot, head, cameras, and what the coordinator does with them."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from handeye.client import (
    ApiError,
    AsyncClient,
    Client,
    Control,
    JobFailed,
    LeaseLost,
    TimedOut,
    WrongArrays,
)
from tests.server.conftest import TOKEN

if TYPE_CHECKING:
    from handeye.client.models import JobEvent
    from tests.server.conftest import Lab


def test_the_arm_moves_under_the_lease(lab: Lab, client: Client) -> None:
    with client.control("alice") as arm:
        assert arm.move_to_joints([0.1] * 6, speed=0.2).joints == pytest.approx([0.1] * 6)
        assert arm.adjust_joints([0.1] * 6).joints == pytest.approx([0.2] * 6)
        assert arm.close_gripper().gripper_opening == pytest.approx(0.065)
        assert arm.open_gripper().gripper_opening == pytest.approx(0.09)
        arm.move_to_point((0.5, 0.0, 0.3))
        before = arm.state().world_time
        assert arm.advance(0.5).world_time == pytest.approx(before + 0.5)
        assert arm.park(0.3, 0.3).joints == pytest.approx(lab.robot.description.park)
        assert arm.turn_head(0.2, -0.1).pan == pytest.approx(0.2)
        with pytest.raises(ApiError, match="alice"), client.control("bob"):
            pass
    assert not lab.robot.leased
    assert client.head().tilt == pytest.approx(-0.1)
    assert client.robot_description().park == pytest.approx(lab.robot.description.park)
    assert {job.subject for job in client.jobs()} >= {"park", "head", "move_to_point"}


def test_a_stop_ends_a_motion_and_refuses_the_next(lab: Lab, client: Client) -> None:
    client.stop_robot("a cat")
    with client.control("alice") as arm, pytest.raises(JobFailed, match="a cat"):
        arm.park()
    client.reset_robot()
    with client.control("alice") as arm:
        arm.park()


def test_leaving_a_motion_early_brakes_it(lab: Lab, client: Client) -> None:
    lab.robot.hang = True
    with client.control("alice", motion_timeout=0.5) as arm, pytest.raises(TimedOut):
        arm.park()
    assert client.jobs(limit=1)[0].state == "cancelled"
    assert not lab.robot.leased


def test_control_lasts_as_long_as_there_are_signs_of_life(lab: Lab, url: str) -> None:
    with Client(url, TOKEN) as client, client.control("alice") as arm:
        time.sleep(3.0)
        arm.park()

    async def main() -> None:
        async with AsyncClient(url, TOKEN) as client, client.control("alice") as arm:
            await asyncio.sleep(3.0)
            await arm.park()

    asyncio.run(main())


def test_control_that_is_taken_away_is_noticed(lab: Lab, url: str) -> None:
    def taken_away(arm: Control) -> None:
        lab.coordinator.control.close()
        arm.park()

    with Client(url, TOKEN) as client, pytest.raises(LeaseLost), client.control("alice") as arm:
        taken_away(arm)


def test_pictures_are_files_and_arrays(lab: Lab, client: Client) -> None:
    image = client.image("left")
    assert image.pixels.shape == (48, 64, 3)
    assert image.pixels.dtype == np.uint8
    assert image.world_time == pytest.approx(lab.world.time - lab.cameras.latency)
    assert client.frame_png("right").startswith(b"\x89PNG")
    frames = client.frames("left", rate=30.0)
    assert [next(frames)[:2] for _ in range(3)] == [b"\xff\xd8"] * 3
    cast("Any", frames).close()


def test_collects_gazes_follows_and_reaches(lab: Lab, client: Client) -> None:
    client.add_background("blue cup")
    client.add_example("blue cup")
    for row, column, tilt in np.random.default_rng(2).uniform((120, 260, -0.1), (260, 420, 0.1), (8, 3)):
        lab.world.cup, lab.world.head = np.array([row, column, 150.0]), (0.0, tilt)
        collected = client.collect_fixation("blue cup").raise_for_failure().result
        assert collected is not None
        assert collected.added["SCS"] > 3
    lab.world.cup, lab.world.head = np.array([200.0, 300.0, 150.0]), (0.0, 0.0)
    seen = client.look("blue cup")
    assert seen.point == (200.0, 300.0, 150.0)
    gaze = client.gaze("blue cup").raise_for_failure().result
    assert gaze is not None
    assert gaze.looks[0].offset > 300.0 > 3.0 > gaze.looks[-1].offset
    job = client.pursue("blue cup", 0.5).raise_for_failure()
    assert job.result is not None
    assert (job.kind, job.result.duration) == ("pursuit", 0.5)
    assert 6 <= len(job.result.looks) <= 7  # every tenth of a second of the toy's time, but for how sums are rounded
    assert job.result.looks[-1].offset == pytest.approx(gaze.looks[-1].offset, abs=1.0)
    assert client.job(job.id) == job
    events: list[JobEvent] = []
    babbled = client.collect_postures(
        ["AJS"],
        postures=12,
        lower=(0.5, -0.3, 0.2),
        upper=(0.8, 0.0, 0.44),
        synergies=np.eye(6)[:3].tolist(),
        on_event=events.append,
    )
    assert babbled.raise_for_failure().subject == "AJS"
    assert [event.data["posture"] for event in events if event.kind == "posture"] == list(range(1, 13))
    failed = client.reach((200.0, 300.0, 150.0))
    assert failed.error is not None
    assert failed.error.code == "not_taught"
    with pytest.raises(ApiError, match="grid is not seen"):
        client.collect_grid_view(np.zeros((4, 5, 3)))
    with pytest.raises(WrongArrays, match="rows, columns, 3"):
        client.collect_grid_view(np.zeros((4, 5)))
