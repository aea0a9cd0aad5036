"""The acting loop on the toy world: it converges, it records what it did, and it ends safely."""

from __future__ import annotations

import itertools
import threading
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from sqlalchemy.exc import OperationalError

from handeye.robot_bridge.driver import Joints, Pace, RobotState, unwatched
from handeye.rpc.errors import Busy, DeadlineExceeded, OutOfLimits, Unavailable
from handeye.server.acting import ActingRobot
from handeye.server.acting_jobs import ActingJobs
from handeye.server.album import Picture
from handeye.server.jobs import JobBusy, Jobs
from handeye.server.problem import NotFound
from handeye.server.results import JobState, JobView
from handeye.server.settings import ServerSettings
from handeye.server.store import jobs as stored_jobs
from handeye.server.training import TrainedTask
from tests.server.running import FAR, UNTAUGHT, done, miss, run, train
from tests.server.waiting import until

if TYPE_CHECKING:
    from sqlalchemy import Connection

    from handeye.camera_bridge.driver import Tick
    from handeye.modules.spaces import ImagePoint
    from handeye.server.skill import SkillAnswer
    from tests.server.conftest import Lab


def picture(lab: Lab, job: str, number: int) -> bytes | None:
    with lab.coordinator.store.read() as connection:
        return stored_jobs.picture(connection, job, number)


def test_the_hand_reaches_an_untaught_place_with_an_arm_that_is_not_exact(lab: Lab) -> None:
    train(lab)
    lab.world.reads = 0.9
    job = run(lab)
    assert (job.state, job.error) == (JobState.SUCCEEDED, None)
    assert miss(job) < 0.5
    assert lab.world.joints[3] == pytest.approx(-0.4, abs=0.02)
    grasp, lift = done(job).subtasks
    assert (grasp.name, grasp.state, grasp.aligned, grasp.action) == ("grasp", "succeeded", True, "close_gripper")
    assert (lift.name, lift.state, lift.action) == ("lift", "succeeded", None)
    assert len(grasp.looks) >= 3


def test_one_look_is_worse_than_looking_again(lab: Lab) -> None:
    train(lab)
    lab.world.reads = 0.9
    job = run(lab, one_look=True)
    assert job.state is JobState.SUCCEEDED
    assert [len(subtask.looks) for subtask in done(job).subtasks] == [1, 1]
    assert not done(job).subtasks[0].aligned
    assert miss(job) > 3.0


def test_an_acting_task_adjusts_joints_moves_the_gripper_waits_and_nothing_else(lab: Lab) -> None:
    train(lab)
    run(lab)
    assert set(lab.robot.commands) == {"adjust_joints", "close_gripper", "advance"}
    lab.robot.commands.clear()
    lab.robot.reset()
    lab.world.cup = FAR
    run(lab)
    assert set(lab.robot.commands) <= {"adjust_joints", "advance", "stop"}


def test_the_facade_has_no_other_way_to_the_robot(lab: Lab) -> None:
    robot = ActingRobot(lab.robot, unwatched, Pace())
    allowed = {"adjust_joints", "open_gripper", "close_gripper", "wait", "stop", "state", "at_rest", "lockstep", "beat"}
    assert {name for name in dir(robot) if not name.startswith("_")} == allowed
    assert not hasattr(robot, "__dict__")


def test_every_look_is_recorded_with_where_its_answer_came_from(lab: Lab) -> None:
    train(lab)
    job = run(lab)
    looks = [look for subtask in done(job).subtasks for look in subtask.looks]
    for number, look in enumerate(looks):
        assert look.number == number
        assert 0.0 < look.support <= 1.0
        assert look.picture == f"/v1/jobs/{job.id}/looks/{number}.jpg"
        distances = [neighbour.distance for neighbour in look.neighbours]
        assert distances == sorted(distances)
        assert all((neighbour.demonstration or "").startswith("grasp-") for neighbour in look.neighbours)
    first = looks[0]
    assert first.object == tuple(UNTAUGHT)
    assert first.moved == pytest.approx(first.delta)
    assert looks[-1].moved == () or not done(job).subtasks[-1].aligned


def test_each_look_is_charged_and_shows_the_arm_at_rest(lab: Lab) -> None:
    train(lab, thinking=0.5)
    job = run(lab)
    (grasp, lift), looks = done(job).subtasks, done(job).subtasks[0].looks
    gaps = np.diff([look.world_time for look in looks])
    # 1 s motion, 0.5 s thinking, and the cameras' latency with what the right picture is later
    assert gaps == pytest.approx(1.57, abs=0.03)
    assert grasp.ended is not None
    assert looks[-1].world_time < grasp.ended <= lift.started
    assert lift.ended is not None
    assert lab.world.time == pytest.approx(lift.ended + 2.5, abs=0.05)


def test_looks_run_out_and_the_task_goes_on_with_what_is_acceptable(lab: Lab) -> None:
    train(lab, max_looks=6, tolerance=1e-9, last_tolerance=1e-9)
    lab.world.reads = 0.9
    job = run(lab)
    assert (job.state, job.error) == (JobState.SUCCEEDED, None)
    for subtask in done(job).subtasks:
        assert (subtask.state, subtask.aligned, len(subtask.looks)) == ("succeeded", False, 6)
        assert 1e-9 < max(np.abs(subtask.looks[-1].delta)) <= 0.006


def test_looks_run_out_far_from_the_goal_and_the_gripper_does_not_close(lab: Lab) -> None:
    train(lab, max_looks=2)
    lab.world.reads = 0.5
    job = failed(lab, "not_aligned")
    (grasp,) = done(job).subtasks
    assert (grasp.state, grasp.aligned, len(grasp.looks)) == ("failed", False, 2)
    assert job.error is not None
    assert f"{max(np.abs(grasp.looks[-1].delta)):.4f} rad" in job.error.message
    assert "after 2 looks" in job.error.message
    assert "close_gripper" not in lab.robot.commands


def test_looks_run_out_where_no_gripper_acts_and_the_task_goes_on(lab: Lab) -> None:
    train(lab, max_looks=6, last_tolerance=1e-9, acceptable=1e-9)
    lab.world.reads = 0.9
    job = run(lab)
    assert (job.state, job.error) == (JobState.SUCCEEDED, None)
    grasp, lift = done(job).subtasks
    assert (grasp.aligned, lift.aligned, lift.action) == (True, False, None)
    assert max(np.abs(lift.looks[-1].delta)) > 1e-9


def test_the_last_subtask_may_end_with_its_own_wider_tolerance(lab: Lab) -> None:
    train(lab, acceptable=1e-6)
    assert run(lab).state is JobState.SUCCEEDED


def failed(lab: Lab, code: str) -> JobView:
    """Runs the task and checks that it failed with `code`, the arm stopped."""
    job = run(lab)
    assert job.state is JobState.FAILED
    assert job.error is not None
    assert job.error.code == code
    assert lab.robot.commands[-1] == "stop"
    assert not lab.robot.leased
    return job


@pytest.mark.parametrize("hidden", ["hand", "object"])
def test_what_is_not_seen_stops_the_arm(lab: Lab, hidden: str) -> None:
    train(lab)
    lab.world.hidden.add(hidden)
    job = failed(lab, "not_seen")
    assert job.error is not None
    assert hidden in job.error.message
    assert hidden in lab.robot.stopped
    assert done(job).subtasks[0].state == "failed"
    assert picture(lab, job.id, 0) is not None


def test_outside_the_taught_region_the_task_holds_and_asks_for_a_demonstration(lab: Lab) -> None:
    train(lab)
    lab.world.cup = FAR
    job = failed(lab, "outside_taught_region")
    assert job.error is not None
    assert "outside the taught region" in job.error.message
    assert "nearest demonstration is 'grasp-" in job.error.message
    assert "row 100, column 600, disparity 150" in job.error.message
    look = done(job).subtasks[0].looks[-1]
    assert look.moved == ()
    assert look.support < 0.2
    assert "adjust_joints" not in lab.robot.commands


def test_where_css_was_not_taught_the_task_holds_and_asks_for_grids(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    train(lab)
    answering = TrainedTask.answer

    def unsure(self: TrainedTask, *query: Any) -> SkillAnswer:
        return replace(answering(self, *query), seen=0.1)

    monkeypatch.setattr(TrainedTask, "answer", unsure)
    job = failed(lab, "outside_taught_region")
    assert job.error is not None
    assert "collect CSS" in job.error.message
    assert done(job).subtasks[0].looks[-1].support == 0.1
    assert "adjust_joints" not in lab.robot.commands


def test_an_answer_that_asks_for_too_large_a_move_is_refused(lab: Lab) -> None:
    train(lab, largest_move=0.1)
    job = failed(lab, "out_of_limits")
    assert job.error is not None
    assert "joint" in job.error.message
    assert "adjust_joints" not in lab.robot.commands


@pytest.mark.parametrize(("joint", "code"), [(4, None), (0, "not_aligned")])
def test_what_brings_the_hand_nowhere_does_not_matter(
    lab: Lab, monkeypatch: pytest.MonkeyPatch, joint: int, code: str | None
) -> None:
    """Answers that ask for a little more again and again: a stretched arm's elbow may turn, and the hand stays."""
    train(lab, max_looks=4)
    answering = TrainedTask.answer

    def asking(self: TrainedTask, *query: Any) -> SkillAnswer:
        told = answering(self, *query)
        if query[0] == "grasp":
            told.turn.angles[joint] = 0.015
        return told

    monkeypatch.setattr(TrainedTask, "answer", asking)
    job = run(lab)
    assert (None if job.error is None else job.error.code) == code


@pytest.mark.parametrize("number", [0, 1])
def test_nothing_is_done_after_a_look_that_could_not_be_written_down(
    lab: Lab, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    train(lab)
    keep = Picture.keep

    def fail(picture: Picture, connection: Connection) -> None:
        if picture.number == number:
            raise OperationalError("INSERT", None, Exception("database or disk is full"))
        keep(picture, connection)

    monkeypatch.setattr(Picture, "keep", fail)
    job = run(lab)
    assert job.error is not None
    assert job.error.code == "store_failed"
    assert "disk may be full" in job.error.message
    # The first look's own move came before; at the second one the hand was there, and the gripper was to close.
    assert [each for each in lab.robot.commands if each != "advance"] == ["adjust_joints", "stop"]


def test_a_camera_that_is_gone_stops_the_arm(lab: Lab) -> None:
    train(lab)
    lab.cameras.fail_with = Unavailable("Camera.GrabStereo: nobody serves it")
    job = failed(lab, "unavailable")
    assert job.error is not None
    assert "Camera.GrabStereo" in job.error.message


@pytest.mark.parametrize("error", [OutOfLimits("joint 2"), DeadlineExceeded("too slow")])
def test_a_refused_motion_stops_the_arm(lab: Lab, error: OutOfLimits | DeadlineExceeded) -> None:
    train(lab)
    lab.robot.fail_with = error
    failed(lab, "out_of_limits" if isinstance(error, OutOfLimits) else "deadline_exceeded")


def test_a_stopped_robot_fails_the_task_until_reset(lab: Lab) -> None:
    train(lab)
    lab.robot.stop("a person")
    failed(lab, "stopped")
    lab.robot.reset()
    assert run(lab).state is JobState.SUCCEEDED


def test_a_robot_that_is_gone_fails_the_job_even_though_it_cannot_be_stopped(lab: Lab) -> None:
    train(lab)
    lab.robot.fail_with = Unavailable("Robot.GetState: nobody serves it")
    job = lab.coordinator.run("grasp", "blue cup", one_look=False)
    assert job.wait(30.0)
    assert job.view().state is JobState.FAILED
    (stop,) = [event for event in job.events(0, 0.0) if event.kind == "stop"]
    assert stop.data["stopped"] is False


def test_the_lease_of_another_holder_is_respected(lab: Lab) -> None:
    train(lab)
    with lab.robot.lease():
        job = run(lab)
    assert job.error is not None
    assert job.error.code == "busy"
    assert "teacher" in job.error.message
    assert "adjust_joints" not in lab.robot.commands


def test_cancel_brakes_the_motion_and_stops_the_arm(lab: Lab) -> None:
    train(lab)
    lab.robot.on_step = threading.Event()
    lab.robot.hang = True  # the motion would not end by itself
    job = lab.coordinator.run("grasp", "blue cup", one_look=False)
    assert lab.robot.on_step.wait(10.0)
    with pytest.raises(JobBusy, match=job.id):
        lab.coordinator.run("grasp", "blue cup", one_look=False)
    job.cancel()
    assert job.wait(10.0)
    view = job.view()
    assert (view.state, view.error and view.error.code) == (JobState.CANCELLED, "cancelled")
    assert lab.robot.commands[-1] == "stop"
    assert not lab.world.moving


def test_while_it_waits_for_pictures_the_lease_is_kept_and_cancel_is_heard(lab: Lab) -> None:
    train(lab)
    lab.cameras.gate = threading.Event()  # never set: no picture would come
    job = lab.coordinator.run("grasp", "blue cup", one_look=False)
    assert lab.cameras.waiting.wait(10.0)
    job.cancel()
    assert job.wait(2.0)
    assert job.view().state is JobState.CANCELLED
    assert lab.robot.beats > 0
    assert lab.robot.commands[-1] == "stop"


def test_while_it_waits_for_the_store_the_lease_is_kept_and_cancel_is_heard(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    train(lab)
    writing, go_on = threading.Event(), threading.Event()
    keep = Picture.keep

    def slowly(picture: Picture, connection: Connection) -> None:
        writing.set()
        assert go_on.wait(10.0)
        keep(picture, connection)

    monkeypatch.setattr(Picture, "keep", slowly)
    job = lab.coordinator.run("grasp", "blue cup", one_look=False)
    assert writing.wait(10.0)
    before = lab.robot.beats
    until(lambda: lab.robot.beats >= before + 5)
    job.cancel()
    until(lambda: lab.robot.commands[-1] == "stop")
    go_on.set()
    assert job.wait(5.0)
    assert job.view().state is JobState.CANCELLED


def test_closing_the_coordinator_cancels_what_is_under_way(lab: Lab) -> None:
    train(lab)
    lab.robot.on_step = threading.Event()
    lab.robot.hang = True
    job = lab.coordinator.run("grasp", "blue cup", one_look=False)
    assert lab.robot.on_step.wait(10.0)
    lab.coordinator.close()
    assert job.view().state is JobState.CANCELLED
    assert not any(thread.name.startswith("job-") for thread in threading.enumerate())
    with pytest.raises(JobBusy, match="shutting down"):
        lab.coordinator.run("grasp", "blue cup", one_look=False)


def test_a_bug_fails_the_job_without_showing_its_inside(lab: Lab) -> None:
    train(lab)
    lab.cameras.grab_stereo = lambda *_: 1 / 0  # type: ignore[method-assign, assignment]
    job = failed(lab, "internal")
    assert job.error is not None
    assert "division" not in job.error.message


def test_untrained_tasks_and_unknown_objects_are_refused_at_once(lab: Lab) -> None:
    with pytest.raises(NotFound, match="not trained"):
        lab.coordinator.run("pour", "blue cup", one_look=False)
    train(lab)
    with pytest.raises(NotFound, match="learned: 'blue cup'"):
        lab.coordinator.run("grasp", "red cup", one_look=False)


def test_an_arm_that_never_rests_is_an_error(lab: Lab) -> None:
    lab.world.still_since = np.inf
    lab.robot.leased = True
    with pytest.raises(Busy, match="not come to rest"):
        ActingRobot(lab.robot, unwatched, Pace()).at_rest()


def test_in_realtime_nobody_advances_the_world(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    train(lab, hold=0.0)
    realtime = type(lab.robot.description)(
        **{
            **{name: getattr(lab.robot.description, name) for name in lab.robot.description.__slots__},
            "clock": "realtime",
        }
    )
    monkeypatch.setattr(type(lab.robot), "description", realtime)
    grab = lab.cameras.grab_stereo

    def wait_and_grab(not_older_than: float, timeout: float, on_tick: Tick | None = None) -> object:
        lab.world.time += 0.1  # time passes by itself
        return grab(not_older_than, timeout, on_tick)

    monkeypatch.setattr(lab.cameras, "grab_stereo", wait_and_grab)
    assert run(lab).state is JobState.SUCCEEDED
    assert lab.robot.commands.count("advance") == 1  # the hold at the end


def test_the_newest_jobs_and_pictures_are_kept(lab: Lab) -> None:
    train(lab)
    coordinator = lab.coordinator
    jobs = Jobs(coordinator.store, kept=2)
    settings = ServerSettings(pictures_kept=1)
    coordinator.acting = ActingJobs(jobs, coordinator.robot, coordinator.control, coordinator.eyes, settings)
    ids = []
    for _ in range(3):
        job = lab.coordinator.run("grasp", "blue cup", one_look=True)
        assert job.wait(30.0)
        ids.append(job.id)
    with pytest.raises(NotFound, match="newest 2"):
        jobs.get(ids[0])
    assert jobs.get(ids[1]).ended
    assert picture(lab, ids[1], 0) is None
    assert picture(lab, ids[2], 0) is not None
    assert picture(lab, ids[2], -1) is None


@pytest.mark.parametrize(("noise", "state"), [(0.02, JobState.SUCCEEDED), (0.0, JobState.FAILED)])
def test_answers_that_differ_by_noise_are_averaged(
    lab: Lab, monkeypatch: pytest.MonkeyPatch, noise: float, state: JobState
) -> None:
    train(lab, noise=noise)
    see, looks = lab.sight.see_hand, itertools.count()

    def seeing(*shown: Any) -> tuple[ImagePoint, float]:
        point, confidence = see(*shown)
        off = (0.9, -0.7, 0.6, -0.8)[next(looks) % 4]  # px: 0.6 px are 0.006 rad
        return replace(point, row=point.row + off), confidence

    monkeypatch.setattr(lab.sight, "see_hand", seeing)
    job = run(lab)
    assert job.state is state
    if state is JobState.SUCCEEDED:
        assert done(job).subtasks[0].aligned
        assert miss(job) < 1.5


def test_half_of_a_way_is_gone_where_the_whole_is_refused(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    train(lab)
    adjust = lab.robot.adjust_joints

    def adjusting(delta: Joints, *more: Any) -> RobotState:
        if np.abs(delta).max() > 0.45:
            raise OutOfLimits("the arm would come too near to the table")
        return adjust(delta, *more)

    monkeypatch.setattr(lab.robot, "adjust_joints", adjusting)
    job = run(lab)
    assert (job.state, job.error) == (JobState.SUCCEEDED, None)
    first = done(job).subtasks[0].looks[0]
    assert np.array(first.moved) == pytest.approx(np.array(first.delta) / 2, abs=1e-6)
