"""What goes wrong while a task is under way: a cup slips out of the hand; cup or hand is not seen any more."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from sqlalchemy.exc import OperationalError

from handeye.robot_bridge.driver import Joints, Pace, RobotState, Watch, unwatched
from handeye.rpc.errors import Slipping
from handeye.server.job import Job
from handeye.server.results import JobState
from tests.server.running import FAR, done, miss, run, train

if TYPE_CHECKING:
    from handeye.camera_bridge.driver import StereoPair, Tick
    from tests.server.conftest import Lab


def let_slip(lab: Lab, monkeypatch: pytest.MonkeyPatch, times: int) -> None:
    """At the first motion after each of so many closings the cup slips out of the hand, and the fingers meet."""
    adjust, left = lab.robot.adjust_joints, [times]

    def adjusting(delta: Joints, *more: Any) -> RobotState:
        if left[0] and lab.world.gripper < 0.09:
            left[0] -= 1
            lab.world.gripper = 0.0
        return adjust(delta, *more)

    monkeypatch.setattr(lab.robot, "adjust_joints", adjusting)


def test_a_cup_that_slipped_out_of_the_hand_is_taken_again(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    train(lab)
    let_slip(lab, monkeypatch, times=1)
    job = run(lab)
    assert (job.state, job.error) == (JobState.SUCCEEDED, None)
    tried = [(part.name, part.state) for part in done(job).subtasks]
    assert tried == [("grasp", "succeeded"), ("lift", "failed"), ("grasp", "succeeded"), ("lift", "succeeded")]
    assert lab.world.gripper == 0.065


def test_a_cup_that_slips_again_and_again_is_reported(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    train(lab)
    let_slip(lab, monkeypatch, times=9)
    job = run(lab)
    assert job.state is JobState.FAILED
    assert job.error is not None
    assert job.error.code == "lost_grip"
    assert [part.name for part in done(job).subtasks].count("grasp") == 3
    assert lab.robot.stopped


def test_what_is_held_is_put_back_where_it_was_taken(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    """The cup hangs otherwise in the hand than was ever shown: it is put back the way that it came, and left there."""
    train(lab)
    adjust, close, open_ = lab.robot.adjust_joints, lab.robot.close_gripper, lab.robot.open_gripper
    taken: list[Joints] = []
    left: list[Joints] = []

    def adjusting(delta: Joints, *more: Any) -> RobotState:
        if taken:
            lab.world.cup = FAR
        return adjust(delta, *more)

    def closing(watch: Watch = unwatched) -> RobotState:
        taken.append(lab.world.joints.copy())
        return close(watch)

    def opening(watch: Watch = unwatched) -> RobotState:
        left.append(lab.world.joints.copy())
        return open_(watch)

    monkeypatch.setattr(lab.robot, "adjust_joints", adjusting)
    monkeypatch.setattr(lab.robot, "close_gripper", closing)
    monkeypatch.setattr(lab.robot, "open_gripper", opening)
    job = run(lab)
    assert job.error is not None
    assert job.error.code == "outside_taught_region"  # where the cup is now it cannot be taken
    assert left == [pytest.approx(taken[0], abs=1e-9)]


def test_it_goes_back_the_way_that_it_came(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    """The straight way from a cup that could not be grasped to the beginning may lead through the cup."""
    train(lab, (("approach", -0.2, None), ("grasp", 0.0, "close_gripper")), attempts=2)
    adjust, stops = lab.robot.adjust_joints, [lab.world.joints]

    def adjusting(delta: Joints, *more: Any) -> RobotState:
        after = adjust(delta, *more)
        stops.append(after.joints)
        if after.joints[3] > -0.02:  # at the cup, which is taken away
            lab.world.cup = FAR
        return after

    monkeypatch.setattr(lab.robot, "adjust_joints", adjusting)
    job = run(lab)
    assert [part.name for part in done(job).subtasks][:2] == ["approach", "grasp"]
    far = next(number for number, joints in enumerate(stops) if number and joints[3] > -0.02)
    came, back = stops[1:far], stops[far + 1 :]
    assert came
    assert np.array(back[-len(came) - 1 :]) == pytest.approx(np.array([*reversed(came), stops[0]]), abs=1e-9)


def test_a_gripper_that_has_closed_on_nothing_is_noticed(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    train(lab, attempts=1)
    close = lab.robot.close_gripper

    def closing(watch: Watch = unwatched) -> RobotState:
        close(watch)
        lab.world.gripper = 0.0
        return lab.robot.state()

    monkeypatch.setattr(lab.robot, "close_gripper", closing)
    job = run(lab)
    assert job.error is not None
    assert job.error.code == "lost_grip"
    assert job.error.message.endswith("see where the object is.")


def hide_after(lab: Lab, monkeypatch: pytest.MonkeyPatch, looks: int) -> None:
    """Something hides the hand after so many looks."""
    grab, left = lab.cameras.grab_stereo, [looks]

    def grabbing(not_older_than: float, timeout: float, on_tick: Tick | None = None) -> StereoPair:
        left[0] -= 1
        if left[0] < 0:
            lab.world.hidden.add("hand")
        return grab(not_older_than, timeout, on_tick)

    monkeypatch.setattr(lab.cameras, "grab_stereo", grabbing)


@pytest.mark.parametrize("turned", [0.0, 0.03])
def test_a_hand_that_is_hidden_is_felt(lab: Lab, monkeypatch: pytest.MonkeyPatch, turned: float) -> None:
    """By the joints, and by where it was seen last: so it does not matter how the head stands."""
    train(lab)
    lab.world.head = (turned, 0.0)
    hide_after(lab, monkeypatch, looks=1)
    job = run(lab)
    assert (job.state, job.error) == (JobState.SUCCEEDED, None)
    looks = [look for part in done(job).subtasks for look in part.looks]
    assert [look.hand_seen for look in looks] == [True] + [False] * (len(looks) - 1)
    assert miss(job) < 1.0


def test_what_hides_a_cup_that_is_held_does_not_take_it_out_of_the_hand(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    train(lab)
    close = lab.robot.close_gripper

    def closing(watch: Watch = unwatched) -> RobotState:
        lab.world.hidden.add("object")
        return close(watch)

    monkeypatch.setattr(lab.robot, "close_gripper", closing)
    job = run(lab)
    assert (job.state, job.error) == (JobState.SUCCEEDED, None)
    assert [(part.name, part.aligned) for part in done(job).subtasks] == [("grasp", True), ("lift", False)]
    assert lab.world.gripper == 0.065


def test_a_hand_that_was_never_seen_is_not_guessed(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    train(lab)
    hide_after(lab, monkeypatch, looks=0)
    job = run(lab)
    assert job.error is not None
    assert job.error.code == "not_seen"


def test_a_cup_that_begins_to_slip_is_let_go_and_taken_again(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    """The hand opens where the arm has braked, goes the rest of its way, and only then back to the beginning."""
    train(lab)
    adjust, open_ = lab.robot.adjust_joints, lab.robot.open_gripper
    slipped: list[Joints] = []
    opened: list[Joints] = []
    went: list[Joints] = []

    def adjusting(delta: Joints, pace: Pace, watch: Watch, least_opening: float) -> RobotState:
        if not slipped and lab.world.gripper < 0.09:
            assert least_opening == pytest.approx(0.065 - 0.0008)
            slipped.append(lab.world.joints + delta)
            adjust(delta / 4, pace, watch)
            raise Slipping("the gripper has closed further")
        reached = adjust(delta, pace, watch, least_opening)
        if opened:
            went.append(reached.joints)
        return reached

    def opening(watch: Watch = unwatched) -> RobotState:
        opened.append(lab.world.joints.copy())
        return open_(watch)

    monkeypatch.setattr(lab.robot, "adjust_joints", adjusting)
    monkeypatch.setattr(lab.robot, "open_gripper", opening)
    start = lab.world.joints.copy()
    job = run(lab)
    assert (job.state, job.error) == (JobState.SUCCEEDED, None)
    assert [part.name for part in done(job).subtasks] == ["grasp", "lift", "grasp", "lift"]
    assert not np.allclose(opened[0], slipped[0])
    assert went[:2] == [pytest.approx(slipped[0]), pytest.approx(start)]
    assert lab.world.gripper == 0.065


def test_nothing_is_let_go_that_could_not_be_taken_again(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the last attempt what has only settled in the fingers stays there."""
    train(lab, attempts=2)
    adjust = lab.robot.adjust_joints
    asked: list[float] = []

    def adjusting(delta: Joints, pace: Pace, watch: Watch, least_opening: float) -> RobotState:
        if lab.world.gripper < 0.09:
            asked.append(least_opening)
        if least_opening:
            raise Slipping("the gripper has closed further")
        return adjust(delta, pace, watch, least_opening)

    monkeypatch.setattr(lab.robot, "adjust_joints", adjusting)
    job = run(lab)
    assert (job.state, job.error) == (JobState.SUCCEEDED, None)
    assert [part.name for part in done(job).subtasks] == ["grasp", "lift"] * 2
    assert asked == [pytest.approx(0.065 - 0.0008), 0.0]
    assert lab.world.gripper == 0.065


def test_it_does_not_go_back_before_it_is_written_down_why(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    train(lab)
    let_slip(lab, monkeypatch, times=1)
    publish = Job.publish

    def failing(job: Job, kind: str, *more: Any) -> None:
        if kind == "again":
            raise OperationalError("INSERT", None, Exception("database or disk is full"))
        publish(job, kind, *more)

    monkeypatch.setattr(Job, "publish", failing)
    job = run(lab)
    assert job.error is not None
    assert job.error.code == "store_failed"
    after = lab.robot.commands[lab.robot.commands.index("close_gripper") :]
    assert [each for each in after if each != "advance"] == ["close_gripper", "adjust_joints", "stop"]


def test_a_hand_is_felt_though_a_demonstration_was_deleted_meanwhile(lab: Lab) -> None:
    train(lab)
    ids = [each.id for each in lab.coordinator.demonstrations.trainable("grasp")]
    lab.coordinator.untrain(ids[0])
    assert [each.id for each in lab.coordinator.demonstrations.known(ids)] == ids[1:]
